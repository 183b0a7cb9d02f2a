// One triangle at a time. The edge functions
//   E_ab(p) = (b.x - a.x)(p.y - a.y) - (b.y - a.y)(p.x - a.x)
// are positive inside of a triangle that turns clockwise on the screen (y down), and E_ab + E_bc + E_ca = 2
// area at every p (Pineda, "A parallel algorithm for polygon rasterization", SIGGRAPH 1988). Triangles up to
// 128 pixels a side are walked row by row, four pixels at once, in int32: inside the bounding box |E| is at
// most the box's area, 2^30, and four pixels beside it add less than 2^26. Larger ones take the same steps in
// int64, pixel by pixel.
#include "render/rasterizer.h"

#include <algorithm>

#include "render/edge.h"
#include "render/lanes.h"

namespace slide {
namespace {

constexpr std::int32_t kSmallExtent = (1 << 15) - 1;

/// The pixels whose centres may be covered.
struct PixelBox {
  std::int32_t x0, y0, x1, y1;  ///< inclusive
};

struct EdgeFunction {
  std::int64_t value;   ///< at the centre of pixel (x0, y0) of the box
  std::int64_t step_x;  ///< per pixel
  std::int64_t step_y;  ///< per pixel
  std::int32_t bias;    ///< 0 if the edge owns its points, else -1: inside is value + bias >= 0
};

EdgeFunction edge_function(const ScreenVertex& a, const ScreenVertex& b, const PixelBox& box) {
  const std::int64_t dx = std::int64_t{b.x} - a.x;
  const std::int64_t dy = std::int64_t{b.y} - a.y;
  const std::int64_t px = std::int64_t{box.x0} * kSubpixels - a.x;
  const std::int64_t py = std::int64_t{box.y0} * kSubpixels - a.y;
  return {dx * py - dy * px, -dy * kSubpixels, dx * kSubpixels, owns_its_points(dx, dy) ? 0 : -1};
}

/// An attribute at vertex a and its differences to b and c.
struct Attribute {
  float a, ab, ac;
};

struct Setup {
  PixelBox box;
  EdgeFunction ab, bc, ca;
  float inverse_area;
  Attribute q, s, us, vs;
};

void walk_small(const Setup& s, FragmentBand& band) {
  const Int4 lanes{0, 1, 2, 3};
  const auto start = [&](const EdgeFunction& e) {
    return splat(static_cast<std::int32_t>(e.value)) + lanes * static_cast<std::int32_t>(e.step_x);
  };
  const auto step_x = [](const EdgeFunction& e) { return splat(static_cast<std::int32_t>(4 * e.step_x)); };
  const auto step_y = [](const EdgeFunction& e) { return splat(static_cast<std::int32_t>(e.step_y)); };
  Int4 ab_row = start(s.ab);
  Int4 bc_row = start(s.bc);
  Int4 ca_row = start(s.ca);
  const Float4 inverse_area = splat(s.inverse_area);
  for (std::int32_t y = s.box.y0; y <= s.box.y1; ++y) {
    Int4 ab = ab_row;
    Int4 bc = bc_row;
    Int4 ca = ca_row;
    for (std::int32_t x = s.box.x0; x <= s.box.x1; x += 4) {
      const Int4 inside = ((ab + s.ab.bias) | (bc + s.bc.bias) | (ca + s.ca.bias)) >= 0;
      if (any(inside)) {
        const Float4 b1 = to_float(ca) * inverse_area;
        const Float4 b2 = to_float(ab) * inverse_area;
        const auto value = [&](const Attribute& t) {
          return interpolate(splat(t.a), splat(t.ab), splat(t.ac), b1, b2);
        };
        float* q_out = band.q(y) + x;
        const Float4 q_there = load4(q_out);
        const Float4 q = value(s.q);
        const Int4 nearer = inside & (q > q_there);
        if (any(nearer)) {
          store4(q_out, select(nearer, q, q_there));
          const auto put = [&](float* out, const Attribute& t) {
            store4(out, select(nearer, value(t), load4(out)));
          };
          put(band.s(y) + x, s.s);
          put(band.us(y) + x, s.us);
          put(band.vs(y) + x, s.vs);
        }
      }
      ab += step_x(s.ab);
      bc += step_x(s.bc);
      ca += step_x(s.ca);
    }
    ab_row += step_y(s.ab);
    bc_row += step_y(s.bc);
    ca_row += step_y(s.ca);
  }
}

void walk_large(const Setup& s, FragmentBand& band) {
  for (std::int32_t y = s.box.y0; y <= s.box.y1; ++y) {
    const std::int64_t down = y - s.box.y0;
    std::int64_t ab = s.ab.value + down * s.ab.step_y;
    std::int64_t bc = s.bc.value + down * s.bc.step_y;
    std::int64_t ca = s.ca.value + down * s.ca.step_y;
    for (std::int32_t x = s.box.x0; x <= s.box.x1; ++x) {
      if (((ab + s.ab.bias) | (bc + s.bc.bias) | (ca + s.ca.bias)) >= 0) {
        const float b1 = static_cast<float>(ca) * s.inverse_area;
        const float b2 = static_cast<float>(ab) * s.inverse_area;
        const auto value = [&](const Attribute& t) { return interpolate(t.a, t.ab, t.ac, b1, b2); };
        const float q = value(s.q);
        if (q > band.q(y)[x]) {
          band.q(y)[x] = q;
          band.s(y)[x] = value(s.s);
          band.us(y)[x] = value(s.us);
          band.vs(y)[x] = value(s.vs);
        }
      }
      ab += s.ab.step_x;
      bc += s.bc.step_x;
      ca += s.ca.step_x;
    }
  }
}

}  // namespace

void FragmentBand::reset(int width, int y0, int y1) {
  width_ = width;
  y0_ = y0;
  y1_ = y1;
  stride_ = (static_cast<std::size_t>(width) + 3 + 3) / 4 * 4;
  const std::size_t size = stride_ * static_cast<std::size_t>(y1 - y0);
  q_.assign(size, 0.0F);
  s_.resize(size);
  us_.resize(size);
  vs_.resize(size);
}

void draw_triangle(const ScreenVertex& a, const ScreenVertex& b, const ScreenVertex& c, Faces faces,
                   FragmentBand& band) {
  const auto [x_low, x_high] = std::minmax({a.x, b.x, c.x});
  const auto [y_low, y_high] = std::minmax({a.y, b.y, c.y});
  const PixelBox box{std::max(first_centre(x_low), 0), std::max(first_centre(y_low), band.y0()),
                     std::min(last_centre(x_high), band.width() - 1),
                     std::min(last_centre(y_high), band.y1() - 1)};
  if (box.x0 > box.x1 || box.y0 > box.y1) return;
  const EdgeFunction ab = edge_function(a, b, box);
  const EdgeFunction bc = edge_function(b, c, box);
  const EdgeFunction ca = edge_function(c, a, box);
  const std::int64_t area = ab.value + bc.value + ca.value;
  if (area <= 0) {
    if (area < 0 && faces == Faces::kBoth) draw_triangle(a, c, b, Faces::kFront, band);
    return;
  }
  const Setup setup{box,
                    ab,
                    bc,
                    ca,
                    1.0F / static_cast<float>(area),
                    {a.q, b.q - a.q, c.q - a.q},
                    {a.s, b.s - a.s, c.s - a.s},
                    {a.us, b.us - a.us, c.us - a.us},
                    {a.vs, b.vs - a.vs, c.vs - a.vs}};
  if (x_high - x_low <= kSmallExtent && y_high - y_low <= kSmallExtent) {
    walk_small(setup, band);
  } else {
    walk_large(setup, band);
  }
}

}  // namespace slide
