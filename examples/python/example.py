"""From a photo to depth, a page, and a strip of views.

    python example.py photo.jpg folder
"""

import pathlib
import sys

import numpy as np

import slide

source, folder = sys.argv[1], pathlib.Path(sys.argv[2])
folder.mkdir(parents=True, exist_ok=True)

# The networks are opened once; log tells what each stage of a photo takes.
model = slide.Model(log=print)

# A file becomes a 3D photo, which is a page, a model or an animation.
photo = model.photo(source, parallax=5, frames=6)
photo.save(folder / "photo.html", title=pathlib.Path(source).stem, overwrite=True)

# Its maps are arrays. Without relief there is no background.
disparity = photo.map("disparity")
print("disparity", disparity.shape, "mean", round(float(disparity.mean()), 3))
hole = photo.map("hole")
print("made up behind the front:", f"{100 * hole.mean():.1f} % of the pixels")

# Six views in a row, as one picture, binary PPM.
strip = np.hstack([photo.render(view, width=photo.width // 4, height=photo.height // 4) for view in photo.views])
with open(folder / "strip.ppm", "wb") as file:
    file.write(b"P6\n%d %d\n255\n" % (strip.shape[1], strip.shape[0]))
    file.write(strip.tobytes())

# Depth of more frames of that size: the network is planned and packed already.
frame = photo.render()
for shift in range(3):
    depth = model.disparity(np.roll(frame, shift, axis=1))
