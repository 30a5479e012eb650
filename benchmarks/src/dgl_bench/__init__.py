"""The benchmarks behind `dgl bench`, one package or module a subject."""
