"""Twins of kernels in vector code for CPUs: the same arguments and results, eight lanes at a time.

On a CPU Warp runs a kernel on one thread, one particle after the other. A twin is one native function of C++ with Clang's
vector types, which Warp compiles with its own LLVM; its first arguments are those of the kernel of the same name, and
tests compare each pair.
"""
