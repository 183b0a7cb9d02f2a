#include "runtime/foreign_format.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <string>

namespace slide {
namespace {

constexpr ForeignFormat kWebPage = {
    "a web page",
    "the server sent it instead of the file: open it in a browser to see why, "
    "and download again"};
constexpr ForeignFormat kPointer = {"a Git LFS pointer",
                                    "the data is not in the clone: get it with \"git lfs pull\""};
constexpr ForeignFormat kTar = {"a tar archive", "unpack it and give the file with the weights"};
constexpr ForeignFormat kOnnx = {"an ONNX model",
                                 "give the authors' checkpoint (.pt, .pth) or safetensors file instead"};

struct Magic {
  std::size_t offset;
  std::string_view bytes;
  ForeignFormat format;
};

constexpr std::array<Magic, 8> kMagics = {
    {{0, "version https://git-lfs", kPointer},
     {257, "ustar", kTar},
     {0, "\x1F\x8B", {"a gzip archive", "unpack it and give the file with the weights"}},
     {0, "PK\x03\x04", {"a zip archive, as PyTorch's checkpoints are", "slide_convert reads those"}},
     {0, "\x80\x02\x8A\x0A\x6C\xFC\x9C\x46", {"a PyTorch checkpoint", "slide_convert reads those"}},
     {0, "\x89HDF\r\n", {"an HDF5 file", "give the authors' PyTorch checkpoint or safetensors file instead"}},
     {0, "GGUF", {"a GGUF file", "give the authors' PyTorch checkpoint or safetensors file instead"}},
     {4,
      "TFL3",
      {"a TensorFlow Lite model", "give the authors' PyTorch checkpoint or safetensors file instead"}}}};

bool is_web_page(std::string_view text) {
  const std::size_t first = text.find_first_not_of(" \t\r\n\xEF\xBB\xBF");
  if (first == std::string_view::npos) return false;
  std::string word(text.substr(first, 14));
  std::ranges::transform(word, word.begin(), [](unsigned char c) { return std::tolower(c); });
  return word.starts_with("<!doctype html") || word.starts_with("<html") || word.starts_with("<?xml");
}

/// A ModelProto begins with its ir_version (field 1, a small number), then comes another field of the
/// message.
bool is_onnx(std::string_view text) {
  constexpr std::string_view kFields = "\x12\x1A\x22\x28\x32\x3A\x42";
  return text.size() > 8 && text[0] == 8 && text[1] > 0 && text[1] < 32 &&
         kFields.find(text[2]) != std::string_view::npos;
}

}  // namespace

std::optional<ForeignFormat> foreign_format(std::span<const std::byte> start) {
  const std::string_view text(reinterpret_cast<const char*>(start.data()), start.size());
  if (text.size() > 8 && text[8] == '{') return std::nullopt;  // a safetensors header, after its length
  if (is_web_page(text)) return kWebPage;
  if (is_onnx(text)) return kOnnx;
  for (const Magic& magic : kMagics)
    if (text.size() > magic.offset && text.substr(magic.offset).starts_with(magic.bytes)) return magic.format;
  return std::nullopt;
}

}  // namespace slide
