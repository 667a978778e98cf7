"""Claims, measured: benchmarks, the experiments of the paper, faults and soak of the nodes."""
