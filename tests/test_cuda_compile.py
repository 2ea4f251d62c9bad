"""Every kernel compiles for CUDA, on a machine without a GPU too: Warp brings the compiler."""

import importlib
import pkgutil

import pytest
import warp as wp

import sonarwarp_kernels

ARCHITECTURES = (80, 90)


def kernel_modules() -> dict[str, wp.Module]:
    """Warp modules of every file of ``sonarwarp_kernels`` that holds kernels, by name."""
    modules = {}
    for entry in pkgutil.iter_modules(sonarwarp_kernels.__path__, "sonarwarp_kernels."):
        held = vars(importlib.import_module(entry.name)).values()
        kernels = [value for value in held if isinstance(value, wp.Kernel) and value.func.__module__ == entry.name]
        modules.update({kernel.module.name: kernel.module for kernel in kernels})
    return modules


def compile_for_cuda(module: wp.Module, architecture: int, folder) -> None:
    """Compile to machine code, not only to PTX: the assembler's errors count as well, and it costs no more."""
    (binary,) = wp.compile_aot_module(module, arch=architecture, use_ptx=False, module_dir=folder)
    assert binary.suffix == ".cubin"
    assert binary.stat().st_size > 0


MODULES = kernel_modules()


def test_the_walk_finds_the_files_that_hold_kernels_and_no_others():
    assert {"sonarwarp_kernels.geometry", "sonarwarp_kernels.keys"} <= set(MODULES)
    assert not {"sonarwarp_kernels.launch", "sonarwarp_kernels.specs"} & set(MODULES)


@pytest.mark.parametrize("architecture", ARCHITECTURES)
@pytest.mark.parametrize("name", MODULES)
def test_kernels_compile_for_cuda(name, architecture, tmp_path):
    compile_for_cuda(MODULES[name], architecture, tmp_path)


@wp.func_native("float scratch[n]; for (int i = 0; i < n; ++i) scratch[i] = 1.5f * i; return scratch[n - 1];")
def last_of_scratch(n: int) -> float: ...


@wp.kernel(module="unique", enable_backward=False)
def scratch_kernel(n: int, last_out: wp.array(dtype=float)):
    last_out[wp.tid()] = last_of_scratch(n)


def test_what_only_the_cuda_compiler_refuses_is_caught(tmp_path):
    # An array as long as an argument says: the CPU's compiler has it as an extension, CUDA has no such thing.
    last = wp.zeros(1, dtype=float, device="cpu")
    wp.launch(scratch_kernel, 1, inputs=[5], outputs=[last], device="cpu")
    assert last.numpy()[0] == 6.0
    with pytest.raises(Exception, match="CUDA kernel build failed"):
        compile_for_cuda(scratch_kernel.module, ARCHITECTURES[0], tmp_path)
