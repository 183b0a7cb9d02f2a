"""What is measured: networks at sizes, the weights they get and the inputs made from a photo."""
import os
from dataclasses import dataclass

import numpy as np

HERE = os.path.dirname(os.path.abspath(__file__))
ROOT = os.path.join(HERE, '../..')
PHOTOS = [os.path.join(ROOT, 'examples/photos', name) for name in ('astronaut.png', 'chelsea.png')]
CALIBRATION_PHOTOS = 6  # photo() of 0, 1, ...
MEAN, STD = np.array([.485, .456, .406]), np.array([.229, .224, .225])


@dataclass
class Case:
    name: str
    network: str         # in graphs/catalogue.cpp
    module: str          # in networks.py
    size: tuple          # height, width
    width: int = 0       # argument of the module, where it takes one
    weights: str = ''    # a file of the repository; else the formula
    onnx: bool = True    # can be exported: ONNX has no running maximum, which the fill's texture needs
    quick: bool = False  # part of a quick run
    heavy: bool = False  # seconds a run: few rounds, two threads only
    quantise: bool = False
    int8_budget: float = 0  # SLIDE's plan of 8-bit integers is calibrated and may err so much; 0: neither

    @property
    def inputs(self):
        return INPUTS[self.network]

    @property
    def weight_name(self):
        return self.name.rsplit('_', 1)[0]


INPUTS = {
    'midas_v21': ['x'], 'depth_anything_v2_vits': ['x'], 'midas_v21_small': ['x'], 'u2net': ['x'], 'u2netp': ['x'], 'slide_depth': ['x'],
    'inpaint_coarse': ['rgbd', 'mask'], 'inpaint_deepfill': ['rgbd', 'mask'], 'slide_inpaint': ['rgbd', 'disparity', 'hole'],
    'fba': ['image', 'two_chan_trimap', 'image_n', 'trimap_transformed'],
}

CASES = [
    Case('midas_v21_384x384', 'midas_v21', 'MidasV21', (384, 384), quick=True, quantise=True, int8_budget=.5),
    Case('midas_v21_small_256x256', 'midas_v21_small', 'MidasV21Small', (256, 256), quick=True, quantise=True, int8_budget=.13),
    Case('midas_v21_small_256x384', 'midas_v21_small', 'MidasV21Small', (256, 384), quantise=True, int8_budget=.1),
    Case('depth_anything_v2_vits_518x518', 'depth_anything_v2_vits', 'DepthAnythingV2', (518, 518)),
    Case('inpaint_coarse_w24_256x256', 'inpaint_coarse', 'InpaintCoarse', (256, 256), 24, quick=True, quantise=True),
    Case('inpaint_coarse_w48_256x256', 'inpaint_coarse', 'InpaintCoarse', (256, 256), 48, quick=True, quantise=True),
    Case('inpaint_coarse_w24_672x1008', 'inpaint_coarse', 'InpaintCoarse', (672, 1008), 24, quantise=True),
    Case('inpaint_coarse_w48_672x1008', 'inpaint_coarse', 'InpaintCoarse', (672, 1008), 48, heavy=True, quantise=True),
    Case('inpaint_deepfill_w48_256x256', 'inpaint_deepfill', 'InpaintDeepfill', (256, 256), 48, onnx=False, quick=True),
    Case('inpaint_deepfill_w12_672x1008', 'inpaint_deepfill', 'InpaintDeepfill', (672, 1008), 12, onnx=False, heavy=True),
    Case('inpaint_deepfill_w48_672x1008', 'inpaint_deepfill', 'InpaintDeepfill', (672, 1008), 48, onnx=False, heavy=True),
    Case('u2net_320x320', 'u2net', 'U2Net', (320, 320), quick=True, quantise=True, int8_budget=.65),
    Case('u2netp_320x320', 'u2netp', 'U2NetP', (320, 320), quick=True, quantise=True, int8_budget=.65),
    Case('fba_512x512', 'fba', 'Fba', (512, 512)),
    Case('slide_depth_256x384', 'slide_depth', 'SlideDepth', (256, 384), weights='weights/slide_depth.safetensors', quick=True,
         quantise=True),
    Case('slide_inpaint_256x256', 'slide_inpaint', 'InpaintNet', (256, 256), weights='weights/slide_inpaint.safetensors', onnx=False),
    Case('slide_inpaint_672x1008', 'slide_inpaint', 'InpaintNet', (672, 1008), weights='weights/slide_inpaint.safetensors', onnx=False),
]


def find(name):
    return next(case for case in CASES if case.name == name)


def planar(image):
    """H x W x C -> 1 x C x H x W of float32."""
    return np.ascontiguousarray(image.astype(np.float32).transpose(2, 0, 1)[None])


def photo(number, size):
    """RGB in [0, 1]. Numbers past the photos are the photos mirrored, then their middles."""
    import cv2
    image = cv2.imread(PHOTOS[number % len(PHOTOS)])[:, :, ::-1].astype(np.float32) / 255
    if number // len(PHOTOS) == 1:
        image = image[:, ::-1]
    if number // len(PHOTOS) == 2:
        h, w = image.shape[:2]
        image = image[h // 4:-h // 4, w // 4:-w // 4]
    return cv2.resize(np.ascontiguousarray(image), size[::-1], interpolation=cv2.INTER_AREA).astype(np.float64)


def trimap(size):
    """Two discs: surely foreground inside the small one, surely background outside the large one -> background, foreground."""
    y, x = np.mgrid[:size[0], :size[1]]
    r = np.hypot(y - size[0] / 2, x - size[1] / 2) / min(size)
    return np.stack([r > .375, r < .25], 2)


def distances(trimap_):
    import cv2
    maps = []
    for region in range(2):
        d = cv2.distanceTransform((~trimap_[:, :, region]).astype(np.uint8), cv2.DIST_L2, 5).astype(np.float64)
        maps += [np.exp(-d ** 2 / (2 * (c * 320) ** 2)) for c in (.02, .08, .16)]
    return np.stack(maps, 2)


def inputs(case, number=0):
    """{name: float32 array} from one of the photos."""
    image = photo(number, case.size)
    disparity = image.mean(2, keepdims=True)
    mask = np.zeros(case.size + (1,))
    h, w = case.size
    mask[h // 4:3 * h // 4, w // 4:3 * w // 4] = 1
    normalised = (image - MEAN) / STD
    regions = trimap(case.size)
    made = {'rgbd': np.concatenate([image, disparity], 2) * 2 - 1, 'mask': mask, 'hole': mask, 'disparity': disparity, 'image': image,
            'two_chan_trimap': regions, 'image_n': normalised, 'x': image * 2 - 1 if case.network == 'slide_depth' else normalised}
    if case.network == 'fba':
        made['trimap_transformed'] = distances(regions)
    return {name: planar(made[name]) for name in case.inputs}
