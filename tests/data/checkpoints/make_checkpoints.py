"""Writes the small PyTorch checkpoints of this folder and what they must give (expected.safetensors).

Made once with Debian 12's python3-torch (1.13.1): /usr/bin/python3 make_checkpoints.py
"""
import collections
import io
import json
import struct
import zipfile

import torch

NAMES = {torch.float64: "F64", torch.float32: "F32", torch.float16: "F16", torch.bfloat16: "BF16",
         torch.int64: "I64", torch.int32: "I32", torch.int16: "I16", torch.int8: "I8", torch.uint8: "U8",
         torch.bool: "BOOL"}


def tensors():
    """Every dtype, and every way in which a tensor can lie in a storage."""
    torch.manual_seed(1)
    shared = torch.randn(4, 6)
    volume = torch.randn(2, 3, 4, 5)
    t = collections.OrderedDict()
    t["conv.weight"] = torch.randn(4, 3, 2, 2)
    t["conv.bias"] = torch.nn.Parameter(torch.randn(4))
    t["bn.num_batches_tracked"] = torch.tensor(1234567890123)
    t["f64"] = torch.randn(3, dtype=torch.float64)
    t["f16"] = torch.randn(5).half()
    t["bf16"] = torch.randn(5).bfloat16()
    for dtype in (torch.int64, torch.int32, torch.int16, torch.int8, torch.uint8):
        t[NAMES[dtype].lower()] = torch.arange(-3, 4).to(dtype)
    t["flag"] = torch.tensor([True, False, True])
    t["whole"] = shared
    t["row"] = shared[2]
    t["column"] = shared[:, 1]
    t["transposed"] = shared.t()
    t["block"] = shared[1:3, 2:5]
    t["every_second"] = shared[::2, ::3]
    t["tied"] = shared
    t["permuted"] = volume.permute(3, 1, 0, 2)
    t["channels_last"] = volume.contiguous(memory_format=torch.channels_last)
    t["expanded"] = torch.randn(3, 1).expand(3, 4)
    t["scalar"] = torch.tensor(2.5)
    t["empty"] = torch.zeros(0, 3)
    t["rank5"] = torch.randn(2, 1, 2, 1, 2)
    t["name with \"quotes\" and \u00e4"] = torch.tensor([7.0])
    return t


def write_expected(path, named):
    header, data = {}, b""
    for name, t in named.items():
        t = t.detach().contiguous()
        raw = (t.view(torch.int16) if t.dtype == torch.bfloat16 else t).numpy().tobytes()
        header[name] = {"dtype": NAMES[t.dtype], "shape": list(t.shape), "data_offsets": [len(data), len(data) + len(raw)]}
        data += raw
    text = json.dumps(header).encode()
    with open(path, "wb") as f:
        f.write(struct.pack("<Q", len(text)) + text + data)


def main():
    t = tensors()
    write_expected("expected.safetensors", t)
    torch.save(t, "zip.pt")
    torch.save(t, "zip_protocol4.pt", pickle_protocol=4)
    torch.save(t, "stream.pt", _use_new_zipfile_serialization=False)

    parallel = collections.OrderedDict(("module." + name, value) for name, value in t.items())
    nested = {"G": parallel, "D": {"x": torch.ones(2)}, "epoch": 7, "lr": 1e-3, "best": None, "done": True,
              "sizes": (1, 2, 3, 4), "list": [1, "two"], "set": {1, 2}, "shape": torch.Size([1, 2])}
    torch.save(nested, "nested_zip.pt")
    torch.save(nested, "nested_stream.pt", _use_new_zipfile_serialization=False)
    torch.save({"a": {"x": torch.ones(2)}, "b": {"y": torch.zeros(3)}}, "several.pt")
    torch.save(torch.nn.Linear(2, 1), "module.pt")
    torch.save(collections.OrderedDict(w=torch.arange(3.0)), "tiny_zip.pt")
    torch.save(collections.OrderedDict(w=torch.arange(3.0)), "tiny_stream.pt", _use_new_zipfile_serialization=False)

    with zipfile.ZipFile("zip.pt") as stored, zipfile.ZipFile("deflated.pt", "w", zipfile.ZIP_DEFLATED) as deflated:
        for info in stored.infolist():
            deflated.writestr(info.filename, stored.read(info))


main()
