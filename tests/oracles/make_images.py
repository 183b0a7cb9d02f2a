#!/usr/bin/env python3
"""Makes the image files of ../data/images. Needs Pillow for the JPEG files; PNG is written by hand, so that every colour
type, bit depth and interlacing occurs and nothing of it comes from libpng."""
import os
import struct
import zlib

from PIL import Image


def sample8(x, y, c):
    return (x * 37 + y * 91 + c * 53 + 11) % 256


def sample16(x, y, c):
    return (x * 9173 + y * 20011 + c * 30011 + 77) % 65536


# --- PNG ---------------------------------------------------------------------------------------------------------
def chunk(kind, data):
    return struct.pack('>I', len(data)) + kind + data + struct.pack('>I', zlib.crc32(kind + data))


def rows(width, height, bits, channels, value, xs, ys):
    out = b''
    for y in ys:
        line = [value(x, y, c) for x in xs for c in range(channels)]
        if bits == 16:
            packed = b''.join(struct.pack('>H', v) for v in line)
        else:
            text = ''.join(format(v, '0%db' % bits) for v in line)
            text += '0' * (-len(text) % 8)
            packed = bytes(int(text[i:i + 8], 2) for i in range(0, len(text), 8))
        out += b'\0' + packed
    return out


ADAM7 = [(0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4), (1, 0, 2, 2), (0, 1, 1, 2)]


def png(name, width, height, bits, colour_type, channels, value, interlaced=False, extra=b'', late=b''):
    data = b''
    if interlaced:
        for x0, y0, dx, dy in ADAM7:
            xs, ys = range(x0, width, dx), range(y0, height, dy)
            if xs and ys:
                data += rows(width, height, bits, channels, value, xs, ys)
    else:
        data = rows(width, height, bits, channels, value, range(width), range(height))
    header = struct.pack('>IIBBBBB', width, height, bits, colour_type, 0, 0, int(interlaced))
    with open(name, 'wb') as f:
        f.write(b'\x89PNG\r\n\x1a\n' + chunk(b'IHDR', header) + extra + chunk(b'IDAT', zlib.compress(data, 9)) + late +
                chunk(b'IEND', b''))


def palette_colour(i):
    return ((i * 16) % 256, (255 - i * 16) % 256, (i * 7) % 256)


# --- EXIF --------------------------------------------------------------------------------------------------------
def tiff(order, ifd0, exif_ifd=()):
    """A TIFF block in byte order '<' or '>'; entries are (tag, type, value), a rational's value a pair."""
    def ifd(entries, at):
        heap_at = at + 2 + 12 * len(entries) + 4
        body, heap = struct.pack(order + 'H', len(entries)), b''
        for tag, kind, value in entries:
            if kind == 5:
                body += struct.pack(order + 'HHII', tag, kind, 1, heap_at + len(heap))
                heap += struct.pack(order + 'II', *value)
            elif kind == 3:
                body += struct.pack(order + 'HHIHH', tag, kind, 1, value, 0)
            else:
                body += struct.pack(order + 'HHII', tag, kind, 1, value)
        return body + struct.pack(order + 'I', 0) + heap
    entries = list(ifd0)
    if exif_ifd:
        entries.append((0x8769, 4, 0))
        entries[-1] = (0x8769, 4, 8 + len(ifd(entries, 8)))
    first = ifd(entries, 8)
    out = (b'II' if order == '<' else b'MM') + struct.pack(order + 'HI', 42, 8) + first
    return out + (ifd(list(exif_ifd), len(out)) if exif_ifd else b'')


def corners():
    """48x32 as shown: red, green, blue and white quarters, clockwise from the top left is red, green, white, blue."""
    image = Image.new('RGB', (48, 32))
    for (x, y), colour in {(0, 0): (255, 0, 0), (24, 0): (0, 255, 0), (0, 16): (0, 0, 255),
                           (24, 16): (255, 255, 255)}.items():
        image.paste(colour, (x, y, x + 24, y + 16))
    return image


# What turns the shown picture into the stored one.
STORED = {1: None, 2: Image.Transpose.FLIP_LEFT_RIGHT, 3: Image.Transpose.ROTATE_180,
          4: Image.Transpose.FLIP_TOP_BOTTOM, 5: Image.Transpose.TRANSPOSE, 6: Image.Transpose.ROTATE_90,
          7: Image.Transpose.TRANSVERSE, 8: Image.Transpose.ROTATE_270}


def main():
    os.chdir(os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'data', 'images'))
    for orientation, operation in STORED.items():
        image = corners() if operation is None else corners().transpose(operation)
        block = tiff('<' if orientation % 2 else '>', [(0x0112, 3, orientation)])
        image.save('orientation_%d.jpg' % orientation, quality=95, subsampling=0, exif=b'Exif\0\0' + block)
    # A portrait stored on its side, 28 mm equivalent.
    corners().transpose(Image.Transpose.ROTATE_90).save(
        'focal_35mm.jpg', quality=95, exif=b'Exif\0\0' + tiff('>', [(0x0112, 3, 6)], [(0xA405, 3, 28)]))
    # 5 mm lens, 12000 pixels per centimetre, recorded at 4800 pixels and made smaller since.
    corners().save('focal_plane.jpg', quality=95, exif=b'Exif\0\0' + tiff(
        '<', [], [(0x920A, 5, (5, 1)), (0xA002, 4, 4800), (0xA20E, 5, (12000, 1)), (0xA210, 3, 3)]))
    corners().convert('CMYK').save('cmyk.jpg')
    corners().convert('L').save('grey.jpg', quality=95)
    corners().save('progressive.jpg', quality=95, subsampling=0, progressive=True)

    png('grey_1.png', 13, 5, 1, 0, 1, lambda x, y, c: (x * y + x) % 2)
    png('grey_8.png', 9, 7, 8, 0, 1, sample8)
    png('grey_16.png', 9, 7, 16, 0, 1, sample16)
    png('grey_alpha_8.png', 9, 7, 8, 4, 2, sample8)
    png('rgb_8.png', 9, 7, 8, 2, 3, sample8)
    png('rgb_16.png', 9, 7, 16, 2, 3, sample16)
    png('rgb_16_interlaced.png', 9, 7, 16, 2, 3, sample16, interlaced=True)
    png('rgb_8_interlaced.png', 9, 7, 8, 2, 3, sample8, interlaced=True)
    png('rgba_16.png', 9, 7, 16, 6, 4, sample16)
    colours = b''.join(bytes(palette_colour(i)) for i in range(16))
    png('palette_4.png', 9, 7, 4, 3, 1, lambda x, y, c: (3 * x + 5 * y) % 16,
        extra=chunk(b'PLTE', colours) + chunk(b'tRNS', bytes([0, 128])))
    stored = corners().transpose(STORED[8])
    png('orientation_8.png', stored.width, stored.height, 8, 2, 3, lambda x, y, c: stored.getpixel((x, y))[c],
        late=chunk(b'eXIf', tiff('>', [(0x0112, 3, 8)])))


main()
