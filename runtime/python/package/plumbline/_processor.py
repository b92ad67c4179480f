"""Check that this processor has the instructions that the native module is compiled for."""

import platform
from typing import Optional, Set

# Those of x86-64-v3, by the names of the kernel; `abm` stands for lzcnt.
NEEDED = ("avx", "avx2", "bmi1", "bmi2", "f16c", "fma", "abm", "movbe", "xsave")


def missing(cpuinfo: str) -> Set[str]:
    """Instructions of `NEEDED` that a processor lacks, by the text of /proc/cpuinfo; none if that does not tell."""
    for line in cpuinfo.splitlines():
        name, _, flags = line.partition(":")
        if name.strip() == "flags":
            return set(NEEDED) - set(flags.split())
    return set()


def check(machine: Optional[str] = None, cpuinfo: str = "/proc/cpuinfo") -> None:
    """Raises `ImportError` if an instruction is missing, where the native module would end the process."""
    if (machine or platform.machine()) != "x86_64":
        return
    try:
        with open(cpuinfo, encoding="utf-8", errors="replace") as file:
            lacking = missing(file.read())
    except OSError:
        return
    if lacking:
        raise ImportError(
            f"plumbline: this processor lacks {', '.join(sorted(lacking))}; the wheel needs x86-64-v3 (any Intel or AMD "
            "processor with AVX2). Build plumbline from source for another processor"
        )
