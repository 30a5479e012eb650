"""Twins of kernels, made of C++."""

import inspect
import linecache
from collections.abc import Callable
from typing import Any, cast

import warp as wp

from dgl_physics._kernels.vector.lanes import LANES

__all__ = ["make_twin"]


def make_twin(
    kernel: Callable[..., None], code: str, *, rest: Callable[..., None] | None = None
) -> Callable[..., None]:
    """Make a kernel of one thread that does the work of `count` threads of another.

    The twin takes `count`, the arguments of the kernel, and `scratch`, an array of int32 that it
    may write to. A kernel whose first argument is `first` solves the constraints of one colour; its
    twin solves all colours in turn, and takes the array `colour_start` instead of `count` and
    `first`. Its code passes `FOR_EACH_COLOUR` a function of the first of up to eight constraints of
    a colour and their number.

    Args:
        kernel: The kernel.
        code: C++ with the arguments' names. With a `rest` it returns the number of threads left
            over, and writes their indices to the beginning of `scratch`.
        rest: Does the work of a left-over thread. Takes its index and the kernel's arguments.
    """
    made = cast(wp.Kernel, kernel)
    own = inspect.get_annotations(made.func)
    if next(iter(own)) == "first":
        del own["first"]
        types = {"colour_start": wp.array(dtype=wp.int32), **own}
    else:
        types = {"count": wp.int32, **own}
    types["scratch"] = wp.array(dtype=wp.int32)
    call = f"native({', '.join(types)})"
    body = [call]
    if rest is not None:
        body = [f"for k in range({call}):", f"    rest(scratch[k], {', '.join(own)})"]
    declared = ", ".join(f"{name}: types[{name!r}]" for name in types)
    lines = [
        "@wp.func_native(code)",
        f"def native({declared}){' -> wp.int32' if rest else ''}: ...",
        "@wp.kernel(enable_backward=False)",
        f"def {made.key}({declared}):",
        *(f"    {line}" for line in body),
    ]
    # Warp reads the source that it compiles.
    file = f"<twin of {made.module.name}.{made.key}>"
    source = "\n".join(lines) + "\n"
    linecache.cache[file] = (len(source), None, source.splitlines(keepends=True), file)
    scope: dict[str, Any] = {
        "__name__": f"{made.module.name}.vector",
        "wp": wp,
        "types": types,
        "code": LANES + code,
        "rest": rest,
    }
    exec(compile(source, file, "exec"), scope)
    return scope[made.key]
