"""Makes the twin of a kernel out of C++."""

import inspect
import linecache
from typing import Any

import warp as wp

from dgl_physics._kernels.vector.lanes import LANES

__all__ = ["make_twin"]


def make_twin(kernel: wp.Kernel, code: str, *, rest: wp.Function | None = None) -> wp.Kernel:
    """Make a kernel of one thread that does what `count` threads of another do.

    The twin takes `count`, the arguments of the kernel, and `scratch`, an array of int32 that it may write to. Where the
    first argument of the kernel is `first`, it solves constraints of one colour; its twin solves those of all, one colour
    after the other, and takes the array `colour_start` in the place of `count` and `first`.

    Args:
        kernel: The kernel that it is the twin of.
        code: C++ with the arguments' names. Its result, where there is a `rest`, is how many threads it has left over,
            whose numbers it writes to the beginning of `scratch`.
        rest: Does what a thread of the kernel does, for those that the code has left over. Takes the number of the
            thread and the arguments of the kernel.
    """
    types = {"count": wp.int32, **inspect.get_annotations(kernel.func)}
    types |= {"scratch": wp.array(dtype=wp.int32), "colour_start": wp.array(dtype=wp.int32)}
    native = [name for name in types if name != "colour_start"]
    taken, body = native, [f"native({', '.join(native)})"]
    if native[1] == "first":
        taken = ["colour_start", *native[2:]]
        body = [
            "for colour in range(colour_start.shape[0] - 1):",
            "    first = colour_start[colour]",
            "    count = colour_start[colour + 1] - first",
            f"    {body[0]}",
        ]
    elif rest is not None:
        body = [f"for k in range({body[0]}):", f"    rest(scratch[k], {', '.join(native[1:-1])})"]

    def declare(names: list[str]) -> str:
        return ", ".join(f"{name}: types[{name!r}]" for name in names)

    lines = [
        "@wp.func_native(code)",
        f"def native({declare(native)}){' -> wp.int32' if rest else ''}: ...",
        "@wp.kernel",
        f"def {kernel.key}({declare(taken)}):",
        *(f"    {line}" for line in body),
    ]
    # Warp reads the source of what it compiles.
    file = f"<twin of {kernel.module.name}.{kernel.key}>"
    source = "\n".join(lines) + "\n"
    linecache.cache[file] = (len(source), None, source.splitlines(keepends=True), file)
    scope: dict[str, Any] = {
        "__name__": f"{kernel.module.name}.vector", "wp": wp, "types": types, "code": LANES + code, "rest": rest
    }  # fmt: skip
    exec(compile(source, file, "exec"), scope)
    return scope[kernel.key]
