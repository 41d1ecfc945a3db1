"""frame_capture: a camera -> camera/frame, camera/image, camera/video."""
