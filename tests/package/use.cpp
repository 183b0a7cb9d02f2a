// The C++ libraries from an installed package: their headers stand on their own, and link.
#include <cstdio>
#include <string>

#include "graphs/slide.h"
#include "ops/conv2d/conv2d.h"
#include "ops/resize/resize.h"
#include "render/camera_path.h"
#include "render/export.h"
#include "render/image_file.h"
#include "render/view.h"
#include "runtime/graph.h"
#include "runtime/version.h"

int main() {
  const slide::Camera camera = slide::make_camera(32, 24);
  const auto views = slide::make_path(camera, {.frames = 5});
  std::printf("SLIDE %s, %zu views\n", std::string(slide::version()).c_str(), views.size());
  return views.size() == 5 ? 0 : 1;
}
