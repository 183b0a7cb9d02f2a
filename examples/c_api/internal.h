#pragma once

#include <algorithm>
#include <cstddef>
#include <cstring>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "examples/c_api/slide.h"
#include "examples/network_files.h"
#include "graphs/pipeline.h"
#include "render/camera.h"
#include "render/image.h"
#include "render/layers.h"
#include "render/view.h"
#include "runtime/error.h"
#include "runtime/program.h"

struct slide_model {
  slide::NetworkFiles files;
  std::unique_ptr<slide::graphs::Pipeline> pipeline;
  slide::graphs::SlideOptions options;  ///< but for what a photo decides
  int max_side = 0;
  int threads = 0;
  slide_log log = nullptr;
  void* user = nullptr;

  void say(const std::string& line) const {
    if (log != nullptr) log(user, line.c_str());
  }
  void say(const slide::graphs::StageReport& stage) const;
};

struct slide_photo {
  slide::Layers layers;
  slide::Tensor disparity, hole, matte;  ///< 1×1×H×W; the matte may be empty
  slide::Camera camera;
  std::vector<slide::View> views;
  std::vector<slide::View> shown;  ///< the same, zoomed so that the photo's edge does not show
  double parallax_percent = 0;     ///< of a page's camera
  double focus = 0;
  std::string source;  ///< the file it comes from, which is never replaced
  int threads = 0;
  std::optional<slide::ViewRenderer> renderer;
};

namespace slide::c_api {

/// Keeps the message for slide_last_error(); "" for none.
void set_last_error(const std::string& message) noexcept;

/// Runs `call` and turns whatever it throws into a status and a message.
template <typename Call>
slide_status guarded(const Call& call) {
  set_last_error("");
  try {
    call();
    return SLIDE_OK;
  } catch (...) {
    const Failure failure = current_failure();
    set_last_error(failure.message);
    return static_cast<slide_status>(exit_code(failure.kind));
  }
}

inline void require(bool good, const char* problem) {
  if (!good) throw Error(ErrorKind::kUsage, problem);
}

inline std::string text(const char* s) { return s == nullptr ? "" : s; }

/// Fills the caller's structure, which may be shorter or longer than this library's.
template <typename Struct>
void fill_defaults(Struct* given, std::size_t size, Struct defaults) {
  if (given == nullptr || size < sizeof(std::size_t)) return;
  defaults.struct_size = size;
  std::memset(static_cast<void*>(given), 0, size);
  std::memcpy(static_cast<void*>(given), &defaults, std::min(size, sizeof defaults));
}

/// The caller's structure as this library has it: fields that it lacks have their defaults.
/// @throws Error(kUsage) if it was not filled in by `init`, or sets a field that this library does not know
template <typename Struct>
Struct completed(const Struct* given, const Struct& defaults, const std::string& init) {
  constexpr std::size_t kLargest = 65536;
  if (given == nullptr) return defaults;
  const std::size_t size = given->struct_size;
  if (size < sizeof(std::size_t) || size > kLargest)
    throw Error(ErrorKind::kUsage, "struct_size is " + std::to_string(size), "call " + init + "() first");
  Struct whole = defaults;
  std::memcpy(static_cast<void*>(&whole), given, std::min(size, sizeof whole));
  const auto* bytes = reinterpret_cast<const unsigned char*>(given);
  for (std::size_t i = sizeof whole; i < size; ++i)
    if (bytes[i] != 0)
      throw Error(ErrorKind::kUsage, "a field is set that this version of the library does not know",
                  "use a newer library");
  whole.struct_size = sizeof whole;
  return whole;
}

/// A caller's pixels: colours as 3 channels, maps as 1. Refuses sizes out of range, layouts that cannot be,
/// and values that are not finite.
[[nodiscard]] Image read_colours(const slide_image* image);
[[nodiscard]] Image read_map(const slide_image& image, const std::string& name);

/// Writes an image into a buffer of its size and channels.
void write_buffer(const Image& image, const slide_buffer& buffer);
/// Refuses a buffer that cannot take that. @throws Error(kUsage)
void check_buffer(const slide_buffer* buffer, int width, int height, int channels);

}  // namespace slide::c_api
