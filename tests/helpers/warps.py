"""Kernels for GPUs, run on a CPU: threads of a block are threads of the system, and those of a warp wait together."""

import ctypes
import re
import threading

import numpy as np

from jaxspatial.engine import cpu, cuda

UNTOUCHED, BEHIND = 0xA5, 64
# What a GPU gives a thread, as functions that ask Python.
ASKED = {"read.ptx.sreg.tid.x": "thread", "read.ptx.sreg.ctaid.x": "block", "read.ptx.sreg.ntid.x": "size"}
FUNCTIONS = """
@thread.address = global ptr null
@block.address = global ptr null
@size.address = global ptr null
@wait.address = global ptr null
"""


def text_for_cpus(text, n):
    """A kernel as IR without address spaces, whose special registers and barriers are calls."""
    text = re.sub(r" ?addrspace\(\d\)", "", text)
    text = text.replace("%frame = addrspacecast ptr %memory to ptr", "%frame = getelementptr i8, ptr %memory, i64 0")
    text = text.replace("ptx_kernel ", "").replace("externally_initialized constant", "constant")
    text = text.replace(str(cuda.N_STATES), str(n))
    text = re.sub(r'call (\w+) asm sideeffect "mov[^(]*\(\w+ ([^)]*)\)', r"bitcast \1 \2 to \1", text)
    for intrinsic, name in ASKED.items():
        text = text.replace(f"@llvm.nvvm.{intrinsic}", f"@{name}")
        body = f"  %f = load ptr, ptr @{name}.address\n  %x = call i32 %f()\n  ret i32 %x\n"
        text = text.replace(f"declare i32 @{name}()", f"define i32 @{name}() {{\n{body}}}")
    text = text.replace("@llvm.nvvm.bar.warp.sync", "@wait")
    body = "  %f = load ptr, ptr @wait.address\n  call void %f()\n  ret void\n"
    return FUNCTIONS + text.replace("declare void @wait(i32)", f"define void @wait(i32 %0) {{\n{body}}}")


def by_warps(code, arrays, n, warps=1):
    """The results of a kernel in blocks of so many warps: arrays (n, size), or of sums (number of warps, size)."""
    assert cpu.is_available()
    engine = cpu._loaded(cpu._object([text_for_cpus(code.text, n)], cpu.host()), cpu.host())
    own, barriers, errors = threading.local(), [threading.Barrier(cuda.WARP, timeout=20) for _ in range(warps)], []
    number = ctypes.CFUNCTYPE(ctypes.c_int32)
    calls = {
        "thread": number(lambda: own.thread),
        "block": number(lambda: own.block),
        "size": number(lambda: warps * cuda.WARP),
        "wait": ctypes.CFUNCTYPE(None)(lambda: barriers[own.thread // cuda.WARP].wait() and None),
    }
    for name, function in calls.items():
        place = ctypes.c_void_p.from_address(engine.get_global_value_address(f"{name}.address"))
        place.value = ctypes.cast(function, ctypes.c_void_p).value
    n_warps = -(-n // cuda.WARP)
    given = [np.ascontiguousarray(x).reshape((len(x), -1)) for x in arrays]
    sizes = [(n_warps if x.is_summed else n) * x.size * x.dtype.itemsize for x in code.results]
    results = [np.full(n_bytes + BEHIND, UNTOUCHED, np.uint8) for n_bytes in sizes]
    pointers = [x.ctypes.data for x in (*given, *results)]
    kernel = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * len(pointers))(engine.get_function_address("kernel"))

    def run(block, thread):
        own.block, own.thread = block, thread
        try:
            kernel(*pointers)
        except Exception as error:
            errors.append(error)

    for block in range(-(-n_warps // warps)):
        threads = [threading.Thread(target=run, args=(block, k)) for k in range(warps * cuda.WARP)]
        for x in threads:
            x.start()
        for x in threads:
            x.join()
    assert not errors and all((y[-BEHIND:] == UNTOUCHED).all() for y in results)
    return [
        y[:-BEHIND].view(x.dtype).reshape((-1, x.size)) if x.size else np.zeros((n, 0), x.dtype)
        for x, y in zip(code.results, results, strict=True)
    ]
