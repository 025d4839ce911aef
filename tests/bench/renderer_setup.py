"""What the programs beside this file need before they can import other renderers."""
import ctypes
import glob
import os
import pathlib
import re
import subprocess
import sys

MITSUBA = "mitsuba==3.9.1"
OLDEST_LLVM = 16  # older ones abort inside Dr.Jit
SKIPPED = 77


def skip(message):
    print(f"{os.path.basename(sys.argv[0])}: skipped: {message}", file=sys.stderr)
    sys.exit(SKIPPED)


def enter_virtual_environment(folder, *packages):
    """Continues this program in a virtual environment that has these packages."""
    if pathlib.Path(sys.prefix) == folder.resolve():
        return
    python = str(folder.resolve() / "bin/python")
    try:
        if not os.path.exists(python):
            subprocess.run([sys.executable, "-m", "venv", "--system-site-packages", folder],
                           check=True, stdout=sys.stderr)
        subprocess.run([python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check",
                        *packages], check=True, stdout=sys.stderr)
    except (subprocess.CalledProcessError, OSError) as error:
        skip(f"{' '.join(packages)} cannot be installed into {folder} ({error}); that needs "
             "python3-venv and a package index")
    os.execv(python, [python, *sys.argv])


def version_of_llvm(path):
    """19 of libLLVM-19.so or libLLVM.so.19.1."""
    found = re.search(r"libLLVM(?:-|\.so\.)(\d+)", os.path.basename(path))
    return int(found[1]) if found else 0


def find_llvm():
    """Makes sure that Dr.Jit finds a libLLVM that it can use."""
    if os.path.exists(os.environ.get("DRJIT_LIBLLVM_PATH", "")):
        return
    folders = ("/usr/lib", "/usr/lib/*", "/usr/lib/llvm-*/lib", "/usr/lib64")
    newest = max((path for folder in folders for path in glob.glob(f"{folder}/libLLVM*.so*")),
                 key=version_of_llvm, default="")
    if version_of_llvm(newest) < OLDEST_LLVM:
        skip(f"no libLLVM {OLDEST_LLVM} or later below /usr/lib: install Debian's libllvm19, or "
             "set DRJIT_LIBLLVM_PATH")
    os.environ["DRJIT_LIBLLVM_PATH"] = newest


def hold_to_avx2():
    """Makes Dr.Jit, which is loaded, compile for AVX2 where the processor has more."""
    import drjit
    core = ctypes.CDLL(os.path.join(os.path.dirname(drjit.__file__), "libdrjit-core.so"))
    # jit_llvm_set_target(cpu, features, vector width), which Python is not offered.
    set_target = core._Z19jit_llvm_set_targetPKcS0_j
    set_target.argtypes = [ctypes.c_char_p, ctypes.c_char_p, ctypes.c_uint32]
    set_target(b"haswell", b"", 8)
