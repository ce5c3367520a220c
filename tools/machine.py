"""What `./dev doctor` reports: versions, cores, memory, disk, CUDA device, and the scale in `params.yaml`."""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
import sys
from importlib.metadata import PackageNotFoundError, version

from pipeline.records.errors import UserError
from pipeline.stages.running import command
from tools.scales import describe

PACKAGES = (
    "dvc",
    "mlflow",
    "torch",
    "warp-lang",
    "mani_skill",
    "sapien",
    "mujoco-core",
    "pin",
    "coal",
    "toppra",
    "open3d",
)


def cuda_device() -> str:
    """Return the name of the first NVIDIA device, or `none`, without importing torch."""
    tool = shutil.which("nvidia-smi")
    if tool is None:
        return "none (not needed)"
    answer = subprocess.run([tool, "--query-gpu=name", "--format=csv,noheader"], capture_output=True, text=True)
    return answer.stdout.splitlines()[0] if answer.returncode == 0 and answer.stdout else "none (not needed)"


def package_versions() -> dict[str, str]:
    """Return the installed versions of the packages that matter most."""

    def installed(name: str) -> str:
        try:
            return version(name)
        except PackageNotFoundError:
            return "MISSING"

    return {name: installed(name) for name in PACKAGES}


@command("machine")
def main() -> int:
    """Print the report; the exit code says whether every package is there."""
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1e9
    packages = package_versions()
    print(f"system      {platform.system()} {platform.release()}, Python {platform.python_version()}")
    print(f"machine     {len(os.sched_getaffinity(0))} cores, {memory:.0f} GB, CUDA device: {cuda_device()}")
    print(f"disk        {shutil.disk_usage('.').free / 1e9:.0f} GB free (packages and results of a demo: about 6 GB)")
    print("packages    " + ", ".join(f"{name} {found}" for name, found in packages.items()))
    try:
        print("parameters  " + describe())
    except UserError as error:
        print(f"parameters  {error}")
        return 2
    return 1 if "MISSING" in packages.values() else 0


if __name__ == "__main__":
    sys.exit(main())
