#include "render/texture.h"

#include <algorithm>

#include "runtime/threads.h"

namespace slide {

Texture::Texture(const Layer& layer)
    : stride_(static_cast<std::size_t>(layer.colour.width) + 1),
      right_(static_cast<float>(layer.colour.width - 1)),
      bottom_(static_cast<float>(layer.colour.height - 1)),
      texels_(4 * stride_ * (static_cast<std::size_t>(layer.colour.height) + 1)) {
  const int width = layer.colour.width;
  const int height = layer.colour.height;
  parallel_for(height + 1, [&](std::int64_t row) {
    const int y = std::min(static_cast<int>(row), height - 1);
    float* out = texels_.data() + 4 * stride_ * static_cast<std::size_t>(row);
    for (int column = 0; column <= width; ++column, out += 4) {
      const int x = std::min(column, width - 1);
      for (int c = 0; c < 3; ++c) out[c] = layer.colour.at(x, y, c);
      out[3] = layer.alpha.empty() ? 1.0F : layer.alpha.at(x, y);
    }
  });
}

}  // namespace slide
