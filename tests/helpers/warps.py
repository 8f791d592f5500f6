"""Kernels for GPUs, run on a CPU: the threads of a warp are threads of the system, which wait for each other."""

import ctypes
import re
import threading

import numpy as np

from jaxspatial.engine import cpu, cuda


def by_warps(code, arrays, n):
    """The results of a kernel: arrays (n, size), or of sums (number of warps, size)."""
    assert cpu.is_available()
    text = re.sub(r" ?addrspace\(\d\)", "", code.text)
    text = text.replace("%frame = addrspacecast ptr %memory to ptr", "%frame = getelementptr i8, ptr %memory, i64 0")
    text = text.replace("ptx_kernel ", "").replace("externally_initialized constant", "constant")
    text = text.replace(str(cuda.N_STATES), str(n))
    text = text.replace("call i32 @llvm.nvvm.read.ptx.sreg.ntid.x()", "add i32 32, 0")
    text = re.sub(r'call (\w+) asm sideeffect "mov[^(]*\(\w+ ([^)]*)\)', r"bitcast \1 \2 to \1", text)
    for name, function in (
        ("read.ptx.sreg.tid.x", "lane"),
        ("read.ptx.sreg.ctaid.x", "block"),
        ("bar.warp.sync", "wait"),
    ):
        text = text.replace(f"@llvm.nvvm.{name}", f"@{function}")
    for name, kind in (("lane", "i32"), ("block", "i32"), ("wait", "void")):
        operand, given = ("i32 %0", "i32 %0") if name == "wait" else ("", "")
        result = "void" if kind == "void" else "i32"
        declared = f"declare {result} @{name}({'i32' if name == 'wait' else ''})"
        body = f"%f = load ptr, ptr @{name}.address\n  %x = call {result} %f({given})\n  ret i32 %x"
        if kind == "void":
            body = f"%f = load ptr, ptr @{name}.address\n  call void %f({given})\n  ret void"
        text = text.replace(declared, f"define {result} @{name}({operand}) {{\n  {body}\n}}")
        text = f"@{name}.address = global ptr null\n{text}"
    engine = cpu._loaded(cpu._object([text], cpu.host()), cpu.host())
    own, barrier, errors = threading.local(), threading.Barrier(cuda.WARP, timeout=20), []
    calls = {
        "lane": ctypes.CFUNCTYPE(ctypes.c_int32)(lambda: own.lane),
        "block": ctypes.CFUNCTYPE(ctypes.c_int32)(lambda: own.block),
        "wait": ctypes.CFUNCTYPE(None, ctypes.c_int32)(lambda _: barrier.wait()),
    }
    for name, function in calls.items():
        place = ctypes.c_void_p.from_address(engine.get_global_value_address(f"{name}.address"))
        place.value = ctypes.cast(function, ctypes.c_void_p).value
    n_warps = -(-n // cuda.WARP)
    given = [np.ascontiguousarray(x).reshape((len(x), -1)) for x in arrays]
    # Behind each result are bytes that a kernel must not touch.
    results = [
        np.full((n_warps if x.is_summed else n) * x.size * x.dtype.itemsize + 64, 0xA5, np.uint8) for x in code.results
    ]
    kernel = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * (len(given) + len(results)))(
        engine.get_function_address("kernel")
    )
    pointers = [x.ctypes.data for x in (*given, *results)]

    def thread(block, lane):
        own.block, own.lane = block, lane
        try:
            kernel(*pointers)
        except Exception as error:
            errors.append(error)

    for block in range(n_warps):
        threads = [threading.Thread(target=thread, args=(block, lane)) for lane in range(cuda.WARP)]
        for x in threads:
            x.start()
        for x in threads:
            x.join()
    assert not errors
    found = []
    for x, y in zip(code.results, results, strict=True):
        assert (y[-64:] == 0xA5).all()
        found.append(y[:-64].view(x.dtype).reshape((-1, x.size)) if x.size else np.zeros((n, 0), x.dtype))
    return found
