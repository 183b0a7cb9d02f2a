"""One photograph becomes a 3D photo: slide.Model holds the networks, slide.Photo what they made of a photo.

Images are NumPy arrays, H×W×3 (or H×W×4, whose alpha is not used, or H×W, grey), uint8 or float32 in [0, 1],
sRGB-encoded. Maps are H×W float32. Disparity is 1 / distance, normalised to [0, 1]; 1 is nearest.

Calls let other Python threads run. One model, or one photo, is used by one thread at a time.
"""

import ctypes
import os

import numpy as np

from . import _library
from ._library import View

__all__ = ["Error", "Model", "Photo", "View", "MAPS", "version"]

_lib = _library.load()

#: The maps of a photo, by number of channels; the order is slide_map's.
MAPS = {"front_colour": 3, "front_disparity": 1, "visibility": 1, "background_colour": 3,
        "background_disparity": 1, "disparity": 1, "hole": 1, "matte": 1}


class Error(RuntimeError):
    """What went wrong, in one sentence; `status` is the number of slide_status."""

    def __init__(self, status, message):
        super().__init__(message)
        self.status = status


def version():
    """The library's version, "0.2.0"."""
    return _lib.slide_version().decode()


class _Callbacks:
    """Python functions that the library calls. What one raises ends the call, and is raised from it."""

    def __init__(self):
        self._raised = None

    def progress(self, function):
        """function(stage, part); False stops."""
        if function is None:
            return _library.PROGRESS()
        return _library.PROGRESS(self._guarded(
            lambda _, stage, part: 0 if function(stage.decode(), part) is False else 1, 0))

    def log(self, function):
        if function is None:
            return _library.LOG()
        return _library.LOG(self._guarded(lambda _, line: function(line.decode()), None))

    def write(self, function):
        def take(_, data, size):
            function(ctypes.string_at(data, size))
            return 1
        return _library.WRITE(self._guarded(take, 0))

    def _guarded(self, function, failed):
        def guarded(*arguments):
            try:
                return function(*arguments)
            except BaseException as problem:  # raised again by check()
                self._raised = self._raised or problem
                return failed
        return guarded

    def check(self, status):
        raised, self._raised = self._raised, None
        if raised is not None:
            raise raised
        if status != 0:
            raise Error(status, _lib.slide_last_error().decode())


def _bytes(text):
    return None if text is None else os.fsencode(text)


def _image(array, channels):
    """A slide_image of an array, and the array it needs to be kept with."""
    array = np.asarray(array)
    if array.dtype != np.uint8:
        if array.dtype.kind not in "f":
            raise TypeError(f"images are uint8 or floats, not {array.dtype}")
        array = array.astype(np.float32, copy=False)
    if array.ndim == 2:
        array = array[:, :, np.newaxis]
    if array.ndim != 3 or array.shape[2] not in channels:
        raise ValueError(f"an image of the shape {array.shape} has not {' or '.join(map(str, channels))} channels")
    # Rows may lie apart, pixels not; rows that run backwards are copied.
    pixel = array.itemsize * array.shape[2]
    if array.strides[2] != array.itemsize or array.strides[1] != pixel or array.strides[0] < pixel * array.shape[1]:
        array = np.ascontiguousarray(array)
    kind = _library.UINT8 if array.dtype == np.uint8 else _library.FLOAT32
    height, width, count = array.shape
    return _library.Image(array.ctypes.data, width, height, count, kind, array.strides[0]), array


def _new(width, height, channels, dtype):
    shape = (height, width) if channels == 1 else (height, width, channels)
    array = np.empty(shape, dtype)
    kind = _library.UINT8 if array.dtype == np.uint8 else _library.FLOAT32
    return array, _library.Image(array.ctypes.data, width, height, channels, kind, 0)


class Model:
    """The networks, prepared once for each size and run for photo after photo, or frame after frame.

    depth_weights, inpaint_weights, matte_weights: safetensors files; None: the weights inside the library.
    inpaint_weights="fill" goes without a network. precision: "fp32", "bf16", "int8", "auto". max_side: larger
    photos are reduced to it. threads: 0, one a core. progress(stage, part) may return False to stop;
    log(line) is told what each stage took.
    """

    def __init__(self, *, depth_weights=None, inpaint_weights=None, matte_weights=None, precision=None,
                 error_budget=0.0, depth_side=0, max_side=1536, threads=0, memory_limit=0, progress=None,
                 log=None):
        self._model = ctypes.c_void_p()
        self._callbacks = _Callbacks()
        settings = _library.Settings()
        _lib.slide_settings_init(settings, ctypes.sizeof(settings))
        settings.depth_weights = _bytes(depth_weights)
        settings.inpaint_weights = _bytes(inpaint_weights)
        settings.matte_weights = _bytes(matte_weights)
        settings.precision = _bytes(precision)
        settings.error_budget = error_budget
        settings.depth_side = depth_side
        settings.max_side = max_side
        settings.threads = threads
        settings.memory_limit = memory_limit
        self._settings = settings  # keeps the callbacks alive
        settings.progress = self._callbacks.progress(progress)
        settings.log = self._callbacks.log(log)
        self._callbacks.check(_lib.slide_model_create(settings, self._model))

    def close(self):
        """Frees the networks; photos stay."""
        model, self._model = self._model, ctypes.c_void_p()
        _lib.slide_model_free(model)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def __del__(self):
        if getattr(self, "_model", None):
            self.close()

    def prepare(self, width, height):
        """Makes the first disparity() of that size as fast as the others."""
        self._callbacks.check(_lib.slide_model_prepare(self._model, width, height))

    def disparity(self, image):
        """Depth alone: H×W float32."""
        given, kept = _image(image, (1, 3, 4))
        out, buffer = _new(given.width, given.height, 1, np.float32)
        self._callbacks.check(_lib.slide_disparity(self._model, given, buffer))
        del kept
        return out

    def photo(self, source, *, disparity=None, matte=None, path=None, parallax=4.0, focus=0.5, frames=60,
              views=None, fov=0.0, near=1.0, far=10.0, find_subject=False):
        """A 3D photo of an array, of an image file's name, or of the bytes of a JPEG or PNG.

        disparity, matte: maps for an array, instead of the networks. path: "circle", "swing", "zoom",
        "dolly-zoom" or a file of poses; views: a list of View instead. parallax: percent of the width.
        fov: degrees, 0: the file's own or 53.13. near, far: depth of disparity 1 and 0.
        find_subject: look for a matte of what stands out.
        """
        scene = _library.Scene()
        _lib.slide_scene_init(scene, ctypes.sizeof(scene))
        scene.path = _bytes(path)
        scene.parallax_percent, scene.focus, scene.frames = parallax, focus, frames
        scene.fov_degrees, scene.near_depth, scene.far_depth = fov, near, far
        scene.find_subject = int(find_subject)
        if views is not None:
            views = (View * len(views))(*views)
            scene.views, scene.view_count = ctypes.cast(views, ctypes.POINTER(View)), len(views)
        photo = ctypes.c_void_p()
        if isinstance(source, (str, os.PathLike, bytes, bytearray, memoryview)):
            if disparity is not None or matte is not None:
                raise ValueError("maps are for arrays: read the file into one")
            if isinstance(source, (str, os.PathLike)):
                status = _lib.slide_open(self._model, _bytes(source), scene, photo)
            else:
                data = bytes(source)
                status = _lib.slide_decode(self._model, data, len(data), scene, photo)
        else:
            image, kept = _image(source, (1, 3, 4))
            maps = [None if map is None else _image(map, (1,)) for map in (disparity, matte)]
            status = _lib.slide_make(self._model, image, *(map and map[0] for map in maps), scene, photo)
            del kept
        self._callbacks.check(status)
        return Photo(photo)


class Photo:
    """Two layers, the maps they come from, and a camera path. Made by Model.photo()."""

    def __init__(self, photo):
        self._photo = photo
        width, height = ctypes.c_int(), ctypes.c_int()
        _Callbacks().check(_lib.slide_photo_size(photo, width, height))
        self.width, self.height = width.value, height.value

    def close(self):
        photo, self._photo = self._photo, ctypes.c_void_p()
        _lib.slide_photo_free(photo)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def __del__(self):
        if getattr(self, "_photo", None):
            self.close()

    def map(self, name):
        """A copy of one of MAPS, H×W or H×W×3 float32; None if the photo has none."""
        number = list(MAPS).index(name)
        if not _lib.slide_photo_has(self._photo, number):
            return None
        out, buffer = _new(self.width, self.height, MAPS[name], np.float32)
        _Callbacks().check(_lib.slide_photo_map(self._photo, number, buffer))
        return out

    @property
    def views(self):
        """The camera path, a list of View."""
        views = [View() for _ in range(_lib.slide_photo_view_count(self._photo))]
        for index, view in enumerate(views):
            _Callbacks().check(_lib.slide_photo_view(self._photo, index, view))
        return views

    def render(self, view=(0.0, 0.0, 0.0), *, width=None, height=None, dtype=np.uint8):
        """The picture from a View, or from the photo's camera moved by (right, down, forward)."""
        if not isinstance(view, View):
            view = _lib.slide_view_at(*view)
        if (width is None) != (height is None):
            raise ValueError("width and height go together")
        size = (self.width, self.height) if width is None else (width, height)
        out, buffer = _new(*size, 3, np.dtype(dtype))
        if out.dtype not in (np.uint8, np.float32):
            raise TypeError("pictures are uint8 or float32")
        _Callbacks().check(_lib.slide_render(self._photo, view, buffer))
        return out

    def save(self, path, **options):
        """Writes .html, .glb, .ply, .gif, .png (APNG), .mp4, .webm, .y4m or a folder of frames.

        options: width, height, fps, supersample, overwrite, title, alt, progress(stage, part).
        """
        callbacks = _Callbacks()
        callbacks.check(_lib.slide_export(self._photo, _bytes(path), _output(callbacks, **options)))

    def encode(self, format, **options):
        """The same as bytes; `format` is "html", "glb", "gif" ..."""
        callbacks = _Callbacks()
        parts = []
        write = callbacks.write(parts.append)
        callbacks.check(_lib.slide_encode(self._photo, _bytes(format), _output(callbacks, **options), write, None))
        return b"".join(parts)


def _output(callbacks, *, width=0, height=0, fps=0.0, supersample=False, overwrite=False, title=None, alt=None,
            progress=None):
    output = _library.Output()
    _lib.slide_output_init(output, ctypes.sizeof(output))
    output.width, output.height, output.fps = width, height, fps
    output.supersample, output.overwrite = int(supersample), int(overwrite)
    output.title = None if title is None else title.encode()
    output.alt = None if alt is None else alt.encode()
    output.progress = callbacks.progress(progress)
    return output
