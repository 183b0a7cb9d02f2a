#include "tests/fuzz/targets.h"

#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <cstddef>
#include <fstream>
#include <iterator>
#include <stdexcept>
#include <string_view>
#include <utility>

#include "ops/case_io.h"
#include "ops/onnx/onnx_file.h"
#include "ops/webnn/webnn_case.h"
#include "render/camera_path.h"
#include "render/codec.h"
#include "render/exif.h"
#include "render/icc.h"
#include "render/image_file.h"
#include "render/oiio.h"
#include "runtime/error.h"
#include "runtime/safetensors.h"
#include "tests/render/phone_photo.h"
#include "weights_tools/weight_reader.h"

namespace slide::fuzz {
namespace {

using Input = std::span<const std::uint8_t>;
using namespace std::string_literals;

Bytes file(const std::string& name) {
  std::ifstream in(std::string(SLIDE_TEST_DATA) + "/" + name, std::ios::binary);
  if (!in) throw std::runtime_error("there is no seed " + name);
  return {std::istreambuf_iterator<char>(in), {}};
}

Bytes text(std::string_view s) { return {s.begin(), s.end()}; }

/// A file without a name on any disk, for readers that take a path.
class MemoryFile {
 public:
  explicit MemoryFile(Input bytes) : descriptor_(::memfd_create("input", MFD_CLOEXEC)) {
    if (descriptor_ < 0 ||
        ::write(descriptor_, bytes.data(), bytes.size()) != static_cast<ssize_t>(bytes.size()))
      throw std::runtime_error("no file in memory can be made");
  }
  ~MemoryFile() { ::close(descriptor_); }
  MemoryFile(const MemoryFile&) = delete;
  MemoryFile& operator=(const MemoryFile&) = delete;
  [[nodiscard]] std::string path() const { return "/proc/self/fd/" + std::to_string(descriptor_); }

 private:
  int descriptor_;
};

/// Whether `read` takes its input; an Error refuses it.
template <typename Read>
bool taken(const Read& read) {
  try {
    read();
    return true;
  } catch (const Error&) {
    return false;
  }
}

/// Keeps the pictures small: what a large one costs is not asked here.
void only_small(int width, int height) {
  if (width > 1024 || height > 1024) throw Error(ErrorKind::kOutOfMemory, "too large for this test");
}

Bytes small_jpeg() { return encode_jpeg(Image(8, 8, 1, 0.25F), 90); }

Target photos(const std::string& name, std::vector<Bytes> seeds) {
  return {name,
          [](Input bytes) {
            return taken([&] { (void)decode_photo(bytes, "input", only_small, EmbeddedMap::kRead); });
          },
          std::move(seeds)};
}

Target maps() {
  const Image map(5, 3, 1, 0.5F);
  std::string header = "{'descr': '<f4', 'fortran_order': False, 'shape': (2, 3), }";
  header.resize(70, ' ');
  Bytes array = text("\x93NUMPY\x01\x00\x46\x00"s + header);
  array.resize(array.size() + 24, 1);
  return {"maps",
          [](Input bytes) {
            if (is_jpeg(bytes) || is_png(bytes)) return false;  // photos' targets
            const MemoryFile input(bytes);
            return taken([&] { (void)read_map(input.path()); });
          },
          {encode_pfm(map), encode_pfm(Image(2, 2, 3, 0.25F)), array}};
}

Target through_openimageio() {
  Bytes bitmap = text(
      "BM"s + "\x46\0\0\0\0\0\0\0\x36\0\0\0\x28\0\0\0\x02\0\0\0\x02\0\0\0\x01\0\x18\0\0\0\0\0\x10\0\0\0"s);
  bitmap.resize(54 + 16, 0);
  return {
      "openimageio",
      [](Input bytes) {
        if (is_jpeg(bytes) || is_png(bytes)) return false;
        const MemoryFile input(bytes);
        return taken([&] { (void)read_photo(input.path(), only_small); });
      },
      {text("P6\n2 2\n255\n012345678901"), text("P3 1 1 255 1 2 3"), bitmap,
       text("GIF89a\x02\0\x02\0\x80\0\0\0\0\0\xFF\xFF\xFF,\0\0\0\0\x02\0\x02\0\0\x02\x03\x44\x02\x05\0;"s),
       text("II*\0\x08\0\0\0\x08\0\0\x01\x03\0\x01\0\0\0\x01\0\0\0\x01\x01\x03\0\x01\0\0\0\x01\0\0\0"
            "\x02\x01\x03\0\x01\0\0\0\x08\0\0\0\x03\x01\x03\0\x01\0\0\0\x01\0\0\0\x06\x01\x03\0\x01\0\0\0"
            "\x01\0\0\0\x11\x01\x04\0\x01\0\0\0\x6E\0\0\0\x16\x01\x03\0\x01\0\0\0\x01\0\0\0\x17\x01\x04\0"
            "\x01\0\0\0\x01\0\0\0\0\0\0\0\x7F\0"s)}};
}

Target exif() {
  Bytes seed = file("images/focal_35mm.jpg");
  const std::string_view view(reinterpret_cast<const char*>(seed.data()), seed.size());
  const std::size_t at = view.find("Exif\0\0"s);
  if (at == std::string_view::npos) throw std::runtime_error("the seed has no EXIF");
  seed.erase(seed.begin(), seed.begin() + static_cast<std::ptrdiff_t>(at) + 6);
  return {"exif", [](Input bytes) { return taken([&] { (void)parse_exif(bytes); }); }, {seed}};
}

/// The profile of a grey picture with a curve of three entries.
Target profiles() {
  Bytes seed(168, 0);
  const auto put = [&](std::size_t at, const std::string& bytes) {
    std::copy(bytes.begin(), bytes.end(), seed.begin() + static_cast<std::ptrdiff_t>(at));
  };
  put(16, "GRAYXYZ ");
  put(36, "acsp");
  put(128, "\0\0\0\1kTRC\0\0\0\x90\0\0\0\x12"s);
  put(144, "curv\0\0\0\0\0\0\0\3\0\0\x27\x10\xFF\xFF"s);
  return {"profiles", [](Input bytes) { return read_icc_profile(bytes).has_value(); }, {seed}};
}

Target safetensors() {
  return {"safetensors",
          [](Input bytes) {
            return taken([&] {
              const auto file = SafetensorsFile::from_memory(std::as_bytes(bytes), "input");
              for (const std::string& name : file.names()) (void)file.tensor(name);
            });
          },
          {file("checkpoints/expected.safetensors")}};
}

Target checkpoints() {
  return {
      "checkpoints",
      [](Input bytes) {
        const MemoryFile input(bytes);
        return taken([&] {
          const auto reader = open_weights(input.path());
          for (std::size_t i = 0; i < reader->tensors().size(); ++i)
            reader->for_each_block(i, [](std::span<const std::byte>) {});
        });
      },
      {file("checkpoints/tiny_zip.pt"), file("checkpoints/tiny_stream.pt"), file("checkpoints/module.pt")}};
}

/// A tensor of ONNX's, and the model that stands in the same bytes.
Target onnx() {
  return {"onnx",
          [](Input bytes) {
            const std::span<const std::byte> message = std::as_bytes(bytes);
            const bool model = taken([&] { (void)ops::parse_onnx_node(message, "model"); });
            return taken([&] { (void)ops::parse_onnx_tensor(message, "tensor"); }) || model;
          },
          {text("\x08\x02\x10\x01\x4a\x08"
                "abcdefgh"),
           text("\x3a\x14\x0a\x12\x0a\x01x\x22\x04Relu\x2a\x07\x0a\x01"
                "a\x42\x02\x01\x02")}};
}

/// A file of WebNN tests, as if it were of one operator after the other.
Target webnn() {
  return {"webnn",
          [](Input bytes) {
            bool any = false;
            for (const char* op : {"conv2d", "average_pool2d", "resample2d", "batch_normalization", "pad",
                                   "concat", "clamp", "reduce_mean", "add"})
              any = taken([&] { (void)ops::parse_webnn_case(std::as_bytes(bytes), op, 1, "input"); }) || any;
            return any;
          },
          {text(R"({"tests": [ // one
{"name": "n", "inputs": {"a": {"shape": [1, 2, 1, 2], "data": [1, 2, 3, 4], "type": "float32"},
"b": {"shape": [1, 2, 1, 1], "data": [1, -1], "type": "float32"}}, "options": {"padding": [0, 1, 0, 1],
"layout": "nhwc", "inputLayout": "nchw", "filterLayout": "oihw", "axes": [2, 3], "minValue": 1, "groups": 1,
"bias": {"shape": [1], "data": [0.5], "type": "float32"}}, "beginningPadding": [0, 0, 1, 0],
"expected": {"name": "y", "shape": [1, 1, 1, 2], "data": [-1.5, -1.5], "type": "float32"}}]})")}};
}

Target cases() {
  return {"cases",
          [](Input bytes) {
            const MemoryFile input(bytes);
            return taken([&] { (void)ops::read_case(input.path()); });
          },
          {file("operator_cases/silu.safetensors")}};
}

Target poses() {
  return {
      "poses",
      [](Input bytes) {
        const std::string_view view(reinterpret_cast<const char*>(bytes.data()), bytes.size());
        return taken([&] { (void)parse_poses(view, "input"); });
      },
      {text(
          R"({"frames": [{"rotation": [[1,0,0],[0,1,0],[0,0,1]], "translation": [0.1, 0, 0], "zoom": 1.5}]})")}};
}

}  // namespace

std::vector<Target> targets() {
  std::vector<Target> all = {
      photos("jpeg",
             {file("images/orientation_6.jpg"), file("images/progressive.jpg"), file("images/grey.jpg"),
              phone::gdepth(small_jpeg(), encode_png(Image(3, 2, 1, 0.5F), 16),
                            "GDepth:Format='RangeLinear' GDepth:Near='2' GDepth:Far='10'"),
              phone::dynamic_depth(small_jpeg(), {}, small_jpeg(), "DepthMap:Format='RangeInverse'")}),
      photos("png", {file("images/rgb_16_interlaced.png"), file("images/palette_4.png"),
                     file("images/orientation_8.png"), file("images/grey_alpha_8.png")}),
      maps(),
      profiles(),
      exif(),
      safetensors(),
      checkpoints(),
      cases(),
      onnx(),
      webnn(),
      poses()};
  if (has_openimageio()) all.push_back(through_openimageio());
  return all;
}

}  // namespace slide::fuzz
