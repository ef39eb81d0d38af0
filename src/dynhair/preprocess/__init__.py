"""From raw multi-view video to a capture: import, matting, hair masks, orientation, landmarks, head tracking."""
