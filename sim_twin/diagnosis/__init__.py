"""Where rig and twin differ, which effect causes it, and how far the gap shrinks once it is in."""
