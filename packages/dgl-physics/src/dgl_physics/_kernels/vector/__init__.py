"""Twins of kernels in vector code for CPUs: the same arguments and results, eight lanes at a time.

On a CPU Warp runs a kernel on one thread, one particle after another. A twin is a native C++
function with Clang's vector types, which Warp compiles with its own LLVM. It takes the arguments of
the kernel of the same name; tests compare each pair.
"""
