#pragma once

#include <string>

namespace slide {

/// Refuses to replace what this program has not made. An existing file may be replaced if it is empty or of
/// the very kind that is written under such a name, told by its content: a 3D photo's page, model, points,
/// PNG or JPEG by the mark that it carries (every one that is written says SLIDE), an endless animation (GIF,
/// APNG), a video (Y4M, MP4, WebM), a map (PFM, EXR). Of a folder, all frame_NNNN.png in it are asked. What
/// does not exist may be made.
/// @param path  the name of an output; "-" stands for standard output and is always fine
/// @throws Error(kUsage) naming the file that would be lost
void require_replaceable(const std::string& path);

}  // namespace slide
