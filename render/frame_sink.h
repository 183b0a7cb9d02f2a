#pragma once

#include <memory>
#include <string>

#include "render/image.h"

namespace slide {

/// What a sequence of frames is: all of one size, shown at one rate, their number known before the first one.
struct FrameFormat {
  int width = 0;
  int height = 0;
  double fps = 30;
  int count = 0;
};

/// Takes the frames of a camera path one by one and makes a file (or a folder) of them. begin, then `count`
/// times frame, then finish; the result appears under its name when finish returns. A sink that is destroyed
/// before that leaves nothing behind (a folder keeps the frames it has got).
///
/// Frames have 3 channels in [0, 1], sRGB-encoded; values outside are clamped.
class FrameSink {
 public:
  virtual ~FrameSink() = default;
  FrameSink(const FrameSink&) = delete;
  FrameSink& operator=(const FrameSink&) = delete;

  /// @throws Error(kUsage) for a rate or size that the format lacks, or without ffmpeg; Error(kOutput) if the
  /// output cannot be made
  void begin(const FrameFormat& format);
  /// @throws Error(kInternal) for a frame of another size or one too many
  void frame(const Image& image);
  /// @throws Error(kInternal) if frames are missing; Error(kOutput) if the output cannot be completed
  void finish();

 protected:
  FrameSink() = default;
  [[nodiscard]] const FrameFormat& format() const noexcept { return format_; }
  /// How many frames came before the one being taken.
  [[nodiscard]] int frames_before() const noexcept { return taken_; }

 private:
  virtual void do_begin() = 0;
  virtual void do_frame(const Image& image) = 0;
  virtual void do_finish() = 0;

  FrameFormat format_;
  int taken_ = 0;
};

/// The sink that a file name asks for:
/// | name                                | what is made |
/// |-------------------------------------|-----------------------------------------------------------------------|
/// | `name/`, no extension, or a folder  | a folder of PNG frames, frame_0000.png and so on | | `.gif` | an
/// endless GIF (render/gif.h)                                         | | `.png`, `.apng` | an endless APNG,
/// or a plain PNG if there is one frame (render/apng.h) | | `.y4m`, `-` (standard output)       |
/// uncompressed video (render/y4m.h)                                     | | `.mp4`, `.webm` | H.264, VP9,
/// through an ffmpeg found on PATH (render/ffmpeg.h)         |
/// @throws Error(kUsage) listing these for any other name
[[nodiscard]] std::unique_ptr<FrameSink> make_frame_sink(const std::string& path);

/// Whether make_frame_sink knows the name.
[[nodiscard]] bool is_frame_output(const std::string& path);

}  // namespace slide
