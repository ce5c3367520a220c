"""Simulated worlds: floating hands, support, Panda and Allegro; contacts and drift."""

import warnings

# SAPIEN says at import that it found no Vulkan of the system; nothing in this room renders.
warnings.filterwarnings("ignore", message="Failed to find system libvulkan", category=UserWarning)
