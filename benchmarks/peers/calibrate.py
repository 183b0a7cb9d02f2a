#!/usr/bin/python3
"""Weights with the ranges and errors of their 8-bit layers, for SLIDE, from the photos that calibrate ONNX Runtime's models.

  calibrate.py OUT BUILD [CASE ...]      slide_convert in BUILD/bin
"""
import os
import subprocess
import sys
import tempfile

import cases


def calibrate(path, case, out, build):
    import cv2
    with tempfile.TemporaryDirectory() as folder:
        photos = []
        for number in range(cases.CALIBRATION_PHOTOS):
            photos.append(f'{folder}/{number}.png')
            cv2.imwrite(photos[-1], (cases.photo(number, case.size)[:, :, ::-1] * 255).round())
        subprocess.run([f'{build}/bin/slide_convert', '--model', case.network, '--calibrate', *photos, '-o', path,
                        f'{out}/{case.weight_name}.weights.safetensors'], check=True)


def main():
    out, build, wanted = sys.argv[1], sys.argv[2], sys.argv[3:]
    for case in cases.CASES:
        path = f'{out}/{case.weight_name}.calibrated.safetensors'
        if case.int8_budget and (not wanted or case.name in wanted) and not os.path.exists(path):
            calibrate(path, case, out, build)


if __name__ == '__main__':
    main()
