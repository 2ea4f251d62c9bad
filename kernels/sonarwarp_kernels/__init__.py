"""GPU and CPU kernels for imaging and profiling sonar; imports Warp only."""
