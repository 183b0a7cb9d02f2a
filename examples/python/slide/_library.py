"""The C API by ctypes: structures and functions as slide.h declares them."""

import ctypes
import os
import pathlib

UINT8, FLOAT32 = 0, 1

PROGRESS = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_char_p, ctypes.c_double)
LOG = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_char_p)
WRITE = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_size_t)


class Image(ctypes.Structure):
    """slide_image and slide_buffer, which have one layout."""

    _fields_ = [("data", ctypes.c_void_p), ("width", ctypes.c_int), ("height", ctypes.c_int),
                ("channels", ctypes.c_int), ("type", ctypes.c_int), ("row_bytes", ctypes.c_size_t)]


class Settings(ctypes.Structure):
    _fields_ = [("struct_size", ctypes.c_size_t), ("depth_weights", ctypes.c_char_p),
                ("inpaint_weights", ctypes.c_char_p), ("matte_weights", ctypes.c_char_p),
                ("precision", ctypes.c_char_p), ("error_budget", ctypes.c_double),
                ("depth_side", ctypes.c_int), ("max_side", ctypes.c_int), ("threads", ctypes.c_int),
                ("memory_limit", ctypes.c_size_t), ("progress", PROGRESS), ("log", LOG),
                ("user", ctypes.c_void_p)]


class View(ctypes.Structure):
    """A place of the camera: X is seen at rotation · X + translation (slide_view)."""

    _fields_ = [("rotation", ctypes.c_double * 9), ("translation", ctypes.c_double * 3),
                ("zoom", ctypes.c_double), ("shift", ctypes.c_double * 2)]

    def __repr__(self):
        return (f"View(rotation={list(self.rotation)}, translation={list(self.translation)}, "
                f"zoom={self.zoom}, shift={list(self.shift)})")


class Scene(ctypes.Structure):
    _fields_ = [("struct_size", ctypes.c_size_t), ("path", ctypes.c_char_p),
                ("parallax_percent", ctypes.c_double), ("focus", ctypes.c_double), ("frames", ctypes.c_int),
                ("views", ctypes.POINTER(View)), ("view_count", ctypes.c_size_t),
                ("fov_degrees", ctypes.c_double), ("near_depth", ctypes.c_double),
                ("far_depth", ctypes.c_double), ("find_subject", ctypes.c_int)]


class Output(ctypes.Structure):
    _fields_ = [("struct_size", ctypes.c_size_t), ("width", ctypes.c_int), ("height", ctypes.c_int),
                ("fps", ctypes.c_double), ("supersample", ctypes.c_int), ("overwrite", ctypes.c_int),
                ("title", ctypes.c_char_p), ("alt", ctypes.c_char_p), ("progress", PROGRESS),
                ("user", ctypes.c_void_p)]


_POINTER = ctypes.c_void_p
_FUNCTIONS = {
    "slide_version": (ctypes.c_char_p, []),
    "slide_last_error": (ctypes.c_char_p, []),
    "slide_settings_init": (None, [ctypes.POINTER(Settings), ctypes.c_size_t]),
    "slide_model_create": (ctypes.c_int, [ctypes.POINTER(Settings), ctypes.POINTER(_POINTER)]),
    "slide_model_free": (None, [_POINTER]),
    "slide_model_prepare": (ctypes.c_int, [_POINTER, ctypes.c_int, ctypes.c_int]),
    "slide_disparity": (ctypes.c_int, [_POINTER, ctypes.POINTER(Image), ctypes.POINTER(Image)]),
    "slide_view_at": (View, [ctypes.c_double, ctypes.c_double, ctypes.c_double]),
    "slide_scene_init": (None, [ctypes.POINTER(Scene), ctypes.c_size_t]),
    "slide_make": (ctypes.c_int, [_POINTER, ctypes.POINTER(Image), ctypes.POINTER(Image),
                                  ctypes.POINTER(Image), ctypes.POINTER(Scene), ctypes.POINTER(_POINTER)]),
    "slide_open": (ctypes.c_int, [_POINTER, ctypes.c_char_p, ctypes.POINTER(Scene), ctypes.POINTER(_POINTER)]),
    "slide_decode": (ctypes.c_int, [_POINTER, ctypes.c_char_p, ctypes.c_size_t, ctypes.POINTER(Scene),
                                    ctypes.POINTER(_POINTER)]),
    "slide_photo_free": (None, [_POINTER]),
    "slide_photo_size": (ctypes.c_int, [_POINTER, ctypes.POINTER(ctypes.c_int), ctypes.POINTER(ctypes.c_int)]),
    "slide_photo_has": (ctypes.c_int, [_POINTER, ctypes.c_int]),
    "slide_photo_map": (ctypes.c_int, [_POINTER, ctypes.c_int, ctypes.POINTER(Image)]),
    "slide_photo_view_count": (ctypes.c_size_t, [_POINTER]),
    "slide_photo_view": (ctypes.c_int, [_POINTER, ctypes.c_size_t, ctypes.POINTER(View)]),
    "slide_render": (ctypes.c_int, [_POINTER, ctypes.POINTER(View), ctypes.POINTER(Image)]),
    "slide_output_init": (None, [ctypes.POINTER(Output), ctypes.c_size_t]),
    "slide_export": (ctypes.c_int, [_POINTER, ctypes.c_char_p, ctypes.POINTER(Output)]),
    "slide_encode": (ctypes.c_int, [_POINTER, ctypes.c_char_p, ctypes.POINTER(Output), WRITE, _POINTER]),
}


def load():
    """The library: SLIDE_LIBRARY, else the one in the package, else one that the system finds."""
    beside = pathlib.Path(__file__).with_name("libslide.so")
    name = os.environ.get("SLIDE_LIBRARY") or (str(beside) if beside.exists() else "libslide.so.0.2")
    library = ctypes.CDLL(name)
    for function, (result, arguments) in _FUNCTIONS.items():
        entry = getattr(library, function)
        entry.restype, entry.argtypes = result, arguments
    return library
