#include "render/mesh.h"

#include <algorithm>
#include <cassert>

#include "runtime/threads.h"

namespace slide {

std::size_t Mesh::triangle_count() const noexcept {
  return full ? 2 * (static_cast<std::size_t>(width) + 1) * (static_cast<std::size_t>(height) + 1)
              : triangles.size();
}

std::array<std::uint32_t, 3> Mesh::triangle(std::size_t index) const {
  if (!full) return triangles[index];
  const std::size_t cell = index / 2;
  const auto cells = static_cast<std::size_t>(width) + 1;
  const auto column = static_cast<std::uint32_t>(cell % cells);
  const auto row = static_cast<std::uint32_t>(cell / cells);
  const auto columns = static_cast<std::uint32_t>(grid_columns());
  const std::uint32_t a = row * columns + column;
  const std::uint32_t b = a + 1;
  const std::uint32_t c = a + columns;
  const std::uint32_t d = c + 1;
  const bool second = index % 2 != 0;
  if (main_diagonal(static_cast<int>(column), static_cast<int>(row))) {
    return second ? std::array{a, d, c} : std::array{a, b, d};
  }
  return second ? std::array{b, d, c} : std::array{a, b, c};
}

Mesh full_mesh(const Image& disparity) {
  assert(disparity.channels == 1);
  Mesh mesh;
  mesh.full = true;
  mesh.width = disparity.width;
  mesh.height = disparity.height;
  const int columns = mesh.grid_columns();
  const auto count = static_cast<std::size_t>(columns) * static_cast<std::size_t>(mesh.grid_rows());
  mesh.u.resize(count);
  mesh.v.resize(count);
  mesh.disparity.resize(count);
  parallel_for(mesh.grid_rows(), [&](std::int64_t row) {
    const float* source = disparity.row(std::clamp(static_cast<int>(row) - 1, 0, mesh.height - 1));
    const float v = std::clamp(static_cast<float>(row) - 1.0F, -0.5F, static_cast<float>(mesh.height) - 0.5F);
    for (int column = 0; column < columns; ++column) {
      const std::size_t i = static_cast<std::size_t>(row) * static_cast<std::size_t>(columns) +
                            static_cast<std::size_t>(column);
      mesh.u[i] = std::clamp(static_cast<float>(column) - 1.0F, -0.5F, static_cast<float>(mesh.width) - 0.5F);
      mesh.v[i] = v;
      mesh.disparity[i] = source[std::clamp(column - 1, 0, mesh.width - 1)];
    }
  });
  return mesh;
}

}  // namespace slide
