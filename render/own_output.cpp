#include "render/own_output.h"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <string_view>

#include "render/write_image.h"
#include "runtime/own_file.h"

namespace slide {
namespace {

namespace fs = std::filesystem;
using namespace std::string_view_literals;

constexpr std::size_t kHead = std::size_t{1} << 16U;  // all marks lie within it

std::string head_of(const fs::path& path) {
  std::string head(kHead, '\0');
  std::ifstream file(path, std::ios::binary);
  file.read(head.data(), static_cast<std::streamsize>(head.size()));
  head.resize(static_cast<std::size_t>(file.gcount()));
  return head;
}

/// What a file of some extension starts with and holds if it is this program's, or of its kind.
struct Kind {
  std::string_view extension;
  std::size_t at;  ///< offset of `magic`
  std::string_view magic;
  std::string_view mark;  ///< somewhere in the head; empty: the magic alone decides
};

constexpr Kind kKinds[] = {
    {".html", 0, "<!DOCTYPE html>", "<meta name=\"generator\" content=\"SLIDE\">"},
    {".htm", 0, "<!DOCTYPE html>", "<meta name=\"generator\" content=\"SLIDE\">"},
    {".glb", 0, "glTF", "\"generator\":\"SLIDE 3D photo\""},
    {".ply", 0, "ply\n", "comment SLIDE"},
    {".gif", 0, "GIF89a", "NETSCAPE2.0"},
    {".png", 0, "\x89PNG\r\n", "tEXtSoftware\0SLIDE"sv},
    {".png", 0, "\x89PNG\r\n", "acTL"},
    {".apng", 0, "\x89PNG\r\n", "acTL"},
    {".apng", 0, "\x89PNG\r\n", "tEXtSoftware\0SLIDE"sv},
    {".jpg", 0, "\xFF\xD8\xFF", "\xFF\xFE\x00\x07SLIDE"sv},
    {".jpeg", 0, "\xFF\xD8\xFF", "\xFF\xFE\x00\x07SLIDE"sv},
    {".y4m", 0, "YUV4MPEG2", ""},
    {".mp4", 4, "ftyp", ""},
    {".webm", 0, "\x1A\x45\xDF\xA3", ""},
    {".pfm", 0, "Pf", ""},
    {".pfm", 0, "PF", ""},
    {".exr", 0, "\x76\x2F\x31\x01", "SLIDE"},
};

bool is_own(const std::string& head, const std::string& extension) {
  return std::any_of(std::begin(kKinds), std::end(kKinds), [&](const Kind& kind) {
    return kind.extension == extension && head.compare(kind.at, kind.magic.size(), kind.magic) == 0 &&
           head.find(kind.mark) != std::string::npos;
  });
}

void require_replaceable_file(const std::string& path) {
  require_own_file(path,
                   [](const std::string& file) { return is_own(head_of(file), lower_extension(file)); });
}

/// frame_0000.png and so on (render/frame_sink.h).
bool is_frame(const std::string& name) {
  constexpr std::string_view kStart = "frame_";
  constexpr std::string_view kEnd = ".png";
  if (name.size() < kStart.size() + 4 + kEnd.size() || !name.starts_with(kStart) || !name.ends_with(kEnd))
    return false;
  return std::all_of(name.begin() + kStart.size(), name.end() - kEnd.size(),
                     [](char c) { return c >= '0' && c <= '9'; });
}

}  // namespace

void require_replaceable(const std::string& path) {
  std::error_code code;
  if (path == "-") return;
  if (!fs::is_directory(path, code)) return require_replaceable_file(path);
  for (fs::directory_iterator entry(path, code), end; !code && entry != end; entry.increment(code))
    if (is_frame(entry->path().filename().string())) require_replaceable_file(entry->path().string());
}

}  // namespace slide
