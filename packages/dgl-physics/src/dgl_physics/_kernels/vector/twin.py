"""Makes the twin of a kernel out of C++."""

import inspect
import linecache
from typing import Any

import warp as wp

from dgl_physics._kernels.vector.lanes import LANES

__all__ = ["make_twin"]


def make_twin(kernel: wp.Kernel, code: str, *, rest: wp.Function | None = None) -> wp.Kernel:
    """Make a kernel of one thread that does what `count` threads of another do.

    The twin takes `count`, the arguments of the kernel, and `scratch`, an array of float32 that it may write to.

    Args:
        kernel: The kernel that it is the twin of.
        code: C++ with the arguments' names. Its one result, where there is a `rest`, is how many places it has left
            over, whose numbers it writes to the beginning of `scratch` as int32.
        rest: Does what a thread of the kernel does, for those that the code has left over. Takes the number of the
            thread and the arguments of the kernel.
    """
    types = {"count": wp.int32, **inspect.get_annotations(kernel.func)}
    types["scratch"] = wp.array(dtype=wp.int32)
    name = kernel.key
    declared = ", ".join(f"{argument}: types[{argument!r}]" for argument in types)
    given = ", ".join(types)
    call = f"native({given})"
    if rest is not None:
        own = ", ".join(list(types)[1:-1])
        call = f"for k in range({call}):\n        rest(scratch[k], {own})"
    lines = [
        "@wp.func_native(code)",
        f"def native({declared}){' -> wp.int32' if rest else ''}: ...",
        "@wp.kernel",
        f"def {name}({declared}):",
        f"    {call}",
    ]
    # Warp reads the source of what it compiles.
    file = f"<twin of {kernel.module.name}.{name}>"
    source = "\n".join(lines) + "\n"
    linecache.cache[file] = (len(source), None, source.splitlines(keepends=True), file)
    scope: dict[str, Any] = {
        "__name__": f"{kernel.module.name}.vector", "wp": wp, "types": types, "code": LANES + code, "rest": rest
    }  # fmt: skip
    exec(compile(source, file, "exec"), scope)
    return scope[name]
