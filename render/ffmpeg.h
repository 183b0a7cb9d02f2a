#pragma once

#include <memory>
#include <string>

#include "render/frame_sink.h"

namespace slide {

/// Compressed video through the `ffmpeg` program found on PATH, which gets Y4M on its standard input: `.mp4`
/// is H.264 (libx264, CRF 18, 4:2:0, index at the front), `.webm` is VP9 (libvpx-vp9, CRF 30). Both are
/// marked BT.709. 4:2:0 needs even sizes: an odd last column or row is left out. begin() throws Error(kUsage)
/// if there is no ffmpeg, frame() and
/// finish() throw Error(kOutput) with what ffmpeg printed if it failed or complained of anything, or if its
/// file is empty.
[[nodiscard]] std::unique_ptr<FrameSink> make_ffmpeg_sink(const std::string& path);

}  // namespace slide
