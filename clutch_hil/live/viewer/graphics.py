"""Graphics: detect a Vulkan driver, of a graphics card or Mesa's software renderer, which the viewer needs to draw."""

import ctypes
import subprocess
import sys

INSTALL = "apt-get install mesa-vulkan-drivers libvulkan1"
MISSING = f"the viewer needs a Vulkan driver to draw; install one with {INSTALL}, or use --web or --save FILE.rrd"
NO_DRIVER = "No graphics adapter was found"  # message of rerun's viewer without a driver
_INSTANCE = 1  # VK_STRUCTURE_TYPE_INSTANCE_CREATE_INFO
_PROBE_TIMEOUT = 60.0  # s; on a quiet machine it takes 0.1 s


def has_vulkan() -> bool:
    """Return whether there is a Vulkan device. A separate process checks: the driver's compiler would conflict with Numba's."""
    command = [sys.executable, "-P", "-m", __name__]
    try:
        return subprocess.run(command, capture_output=True, timeout=_PROBE_TIMEOUT, check=False).returncode == 0
    except subprocess.TimeoutExpired:
        return False


class _InstanceInfo(ctypes.Structure):
    """VkInstanceCreateInfo: type, next, flags, application, and numbers and names of layers and of extensions."""

    _fields_ = (
        ("type", ctypes.c_int), ("next", ctypes.c_void_p), ("flags", ctypes.c_uint32), ("application", ctypes.c_void_p),
        ("layers", ctypes.c_uint32), ("layer_names", ctypes.c_void_p),
        ("extensions", ctypes.c_uint32), ("extension_names", ctypes.c_void_p),
    )  # fmt: skip


def _count_devices() -> int:
    """Return the number of Vulkan devices. Raises OSError where the Vulkan library is missing."""
    library, instance, count = ctypes.CDLL("libvulkan.so.1"), ctypes.c_void_p(), ctypes.c_uint32()
    if library.vkCreateInstance(ctypes.byref(_InstanceInfo(_INSTANCE)), None, ctypes.byref(instance)):
        return 0  # there is no driver
    library.vkEnumeratePhysicalDevices(instance, ctypes.byref(count), None)
    return count.value


if __name__ == "__main__":
    try:
        sys.exit(0 if _count_devices() else 1)
    except OSError:
        sys.exit(1)
