#include <algorithm>
#include <cmath>
#include <vector>

#include "ops/attention/contextual_attention_op.h"
#include "ops/attention/softmax_scale.h"
#include "ops/conv2d/conv2d_op.h"
#include "runtime/threads.h"

namespace slide::ops {
namespace {

/// n×n numbers about (background position l, foreground position p), row-major.
using Matrix = std::vector<double>;
/// One patch of C·patch·patch numbers for each position.
using Patches = std::vector<double>;

struct Reference {
  AttentionGeometry g;
  std::int64_t n;  // positions
  std::vector<double> fuse_weight;

  [[nodiscard]] Patches reduced_patches(const double* x) const;
  [[nodiscard]] Matrix scores(const Patches& background, const Patches& foreground,
                              const std::vector<double>& norms) const;
  [[nodiscard]] Matrix fuse(const Matrix& s) const;
  [[nodiscard]] Matrix transposed(const Matrix& s, std::int64_t rows, std::int64_t columns) const;
  [[nodiscard]] Matrix fused_twice(const Matrix& s) const;
  [[nodiscard]] std::vector<double> usable(const double* mask) const;
  void softmax(Matrix& s, const std::vector<double>& m) const;
  void paste(const Matrix& weights, const double* background, double* y) const;
};

Patches Reference::reduced_patches(const double* x) const {
  Patches patches;
  patches.reserve(static_cast<std::size_t>(n * g.channels * g.patch * g.patch));
  const std::int64_t reach = g.patch / 2;
  for (std::int64_t i = 0; i < g.rows; ++i)
    for (std::int64_t j = 0; j < g.columns; ++j)
      for (std::int64_t c = 0; c < g.channels; ++c)
        for (std::int64_t u = i - reach; u <= i + reach; ++u)
          for (std::int64_t v = j - reach; v <= j + reach; ++v) {
            const bool inside = u >= 0 && u < g.rows && v >= 0 && v < g.columns;
            patches.push_back(inside ? x[c * g.plane() + u * g.rate * g.width + v * g.rate] : 0.0);
          }
  return patches;
}

std::vector<double> norms_of(const Patches& patches, std::int64_t n) {
  const std::size_t size = patches.size() / static_cast<std::size_t>(n);
  std::vector<double> norms;
  for (std::size_t l = 0; l < static_cast<std::size_t>(n); ++l) {
    double sum = 0;
    for (std::size_t i = 0; i < size; ++i) sum += patches[l * size + i] * patches[l * size + i];
    norms.push_back(std::max(std::sqrt(sum), 1e-4));
  }
  return norms;
}

Matrix Reference::scores(const Patches& background, const Patches& foreground,
                         const std::vector<double>& norms) const {
  Matrix s(static_cast<std::size_t>(n * n));
  const std::int64_t size = g.channels * g.patch * g.patch;
  parallel_for(n, [&](std::int64_t l) {
    for (std::int64_t p = 0; p < n; ++p) {
      double sum = 0;
      for (std::int64_t i = 0; i < size; ++i)
        sum += background[static_cast<std::size_t>(l * size + i)] / norms[static_cast<std::size_t>(l)] *
               foreground[static_cast<std::size_t>(p * size + i)];
      s[static_cast<std::size_t>(l * n + p)] = sum;
    }
  });
  return s;
}

/// The fuse kernel over the n×n plane, zero outside.
Matrix Reference::fuse(const Matrix& s) const {
  Conv2dGeometry conv{};
  conv.batch = conv.ic = conv.oc = conv.groups = conv.group_ic = conv.group_oc = 1;
  conv.height = conv.width = conv.oheight = conv.owidth = n;
  conv.kheight = conv.kwidth = g.fuse;
  conv.stride_y = conv.stride_x = conv.dilation_y = conv.dilation_x = 1;
  conv.top = conv.left = g.fuse / 2;
  const Tensor inputs[] = {Tensor::from<double>({1, 1, n, n}, s),
                           Tensor::from<double>({1, 1, g.fuse, g.fuse}, fuse_weight)};
  Matrix out(s.size());
  conv2d_reference(conv, inputs, out);
  return out;
}

/// Both axes of s, positions of a grid of `rows` × `columns` in row-major order, put into column-major order.
Matrix Reference::transposed(const Matrix& s, std::int64_t rows, std::int64_t columns) const {
  const auto other = [&](std::int64_t position) { return position % rows * columns + position / rows; };
  Matrix out(s.size());
  for (std::int64_t l = 0; l < n; ++l)
    for (std::int64_t p = 0; p < n; ++p)
      out[static_cast<std::size_t>(l * n + p)] = s[static_cast<std::size_t>(other(l) * n + other(p))];
  return out;
}

Matrix Reference::fused_twice(const Matrix& s) const {
  return transposed(fuse(transposed(fuse(s), g.rows, g.columns)), g.columns, g.rows);
}

/// m[l]: 1 where the patch at l holds no masked pixel.
std::vector<double> Reference::usable(const double* mask) const {
  std::vector<double> m;
  const std::int64_t reach = g.patch / 2;
  for (std::int64_t i = 0; i < g.rows; ++i)
    for (std::int64_t j = 0; j < g.columns; ++j) {
      double sum = 0;
      for (std::int64_t u = std::max<std::int64_t>(i - reach, 0); u <= std::min(i + reach, g.rows - 1); ++u)
        for (std::int64_t v = std::max<std::int64_t>(j - reach, 0); v <= std::min(j + reach, g.columns - 1);
             ++v)
          sum += mask[u * g.mask_step_y * g.mask_width + v * g.mask_step_x];
      m.push_back(sum == 0 ? 1.0 : 0.0);
    }
  return m;
}

/// s becomes the softmax over l of softmax_scale · m · s.
void Reference::softmax(Matrix& s, const std::vector<double>& m) const {
  parallel_for(n, [&](std::int64_t p) {
    const auto at = [&](std::int64_t l) -> double& { return s[static_cast<std::size_t>(l * n + p)]; };
    double largest = -INFINITY;
    for (std::int64_t l = 0; l < n; ++l) {
      at(l) *= m[static_cast<std::size_t>(l)] * g.softmax_scale;
      largest = std::max(largest, at(l));
    }
    double sum = 0;
    for (std::int64_t l = 0; l < n; ++l) sum += at(l) = std::exp(at(l) - largest);
    for (std::int64_t l = 0; l < n; ++l) at(l) /= sum;
  });
}

/// y = a quarter of the sum over (l, p) of weights[l, p] times the large patch at l, put at p: for each place
/// (u, v) of the patch the mixtures of all its pixels there, then those added where they belong.
void Reference::paste(const Matrix& weights, const double* background, double* y) const {
  const std::int64_t before = g.rate / 2;
  const auto inside = [&](std::int64_t i, std::int64_t j) {
    return i >= 0 && i < g.height && j >= 0 && j < g.width;
  };
  const auto add_place = [&](const double* x, std::int64_t u, std::int64_t v, double* plane) {
    Matrix mixed(static_cast<std::size_t>(n));
    for (std::int64_t l = 0; l < n; ++l) {
      const std::int64_t i = l / g.columns * g.rate + u;
      const std::int64_t j = l % g.columns * g.rate + v;
      const double pixel = inside(i, j) ? x[i * g.width + j] : 0.0;
      const double* row = weights.data() + l * n;
      for (std::int64_t p = 0; p < n; ++p) mixed[static_cast<std::size_t>(p)] += pixel * row[p];
    }
    for (std::int64_t p = 0; p < n; ++p) {
      const std::int64_t i = p / g.columns * g.rate + u;
      const std::int64_t j = p % g.columns * g.rate + v;
      if (inside(i, j)) plane[i * g.width + j] += mixed[static_cast<std::size_t>(p)] / 4;
    }
  };
  parallel_for(g.channels, [&](std::int64_t c) {
    double* plane = y + c * g.plane();
    std::fill(plane, plane + g.plane(), 0.0);
    for (std::int64_t u = -before; u < 2 * g.rate - before; ++u)
      for (std::int64_t v = -before; v < 2 * g.rate - before; ++v)
        add_place(background + c * g.plane(), u, v, plane);
  });
}

Reference make_reference(const AttentionGeometry& g, std::span<const Tensor> inputs) {
  Reference r{g, g.positions(), {}};
  if (inputs.size() == 4) {
    const std::span<const double> weight = inputs[3].data<double>();
    r.fuse_weight.assign(weight.begin(), weight.end());
  } else {
    r.fuse_weight.assign(static_cast<std::size_t>(g.fuse * g.fuse), 0.0);
    for (std::int64_t i = 0; i < g.fuse; ++i) r.fuse_weight[static_cast<std::size_t>(i * g.fuse + i)] = 1;
  }
  return r;
}

std::vector<double> magnitudes(std::span<const double> x) {
  std::vector<double> out;
  for (const double v : x) out.push_back(std::fabs(v));
  return out;
}

/// Before the softmax.
Matrix fused_scores(const Reference& r, std::span<const Tensor> inputs) {
  const Patches foreground = r.reduced_patches(inputs[0].data<double>().data());
  const Patches background = r.reduced_patches(inputs[1].data<double>().data());
  return r.fused_twice(r.scores(background, foreground, norms_of(background, r.n)));
}

void multiply_rows(Matrix& s, const std::vector<double>& m) {
  for (std::size_t l = 0; l < m.size(); ++l)
    for (std::size_t p = 0; p < m.size(); ++p) s[l * m.size() + p] *= m[l];
}

}  // namespace

void ContextualAttentionOp::reference(std::span<const Tensor> inputs, Tensor& output) const {
  const Reference r = make_reference(attention_geometry(shapes_of(inputs), params_), inputs);
  const std::vector<double> m = r.usable(inputs[2].data<double>().data());
  Matrix weights = fused_scores(r, inputs);
  r.softmax(weights, m);
  multiply_rows(weights, m);
  r.paste(weights, inputs[1].data<double>().data(), output.mutable_data<double>().data());
}

/// softmax_error_weights() of a = softmax_scale · m · E, the scores of magnitudes, and the mixture of
/// |background| by them.
void ContextualAttentionOp::error_scale(std::span<const Tensor> inputs, const Tensor& /*output*/,
                                        Tensor& scale) const {
  Reference r = make_reference(attention_geometry(shapes_of(inputs), params_), inputs);
  const auto n = static_cast<std::size_t>(r.n);
  const std::vector<double> m = r.usable(inputs[2].data<double>().data());
  Matrix weights = fused_scores(r, inputs);
  const Patches foreground = r.reduced_patches(inputs[0].data<double>().data());
  const Patches background = r.reduced_patches(inputs[1].data<double>().data());
  r.fuse_weight = magnitudes(r.fuse_weight);
  const Matrix e =
      r.fused_twice(r.scores(magnitudes(background), magnitudes(foreground), norms_of(background, r.n)));
  for (std::size_t p = 0; p < n; ++p) {
    std::vector<double> scores(n), sizes(n);
    for (std::size_t l = 0; l < n; ++l) {
      scores[l] = r.g.softmax_scale * m[l] * weights[l * n + p];
      sizes[l] = std::fabs(r.g.softmax_scale) * m[l] * e[l * n + p];
    }
    const std::vector<double> column = softmax_error_weights(scores, sizes);
    for (std::size_t l = 0; l < n; ++l) weights[l * n + p] = column[l] + 0x1p-102;
  }
  multiply_rows(weights, m);
  const std::vector<double> absolute = magnitudes(inputs[1].data<double>());
  r.paste(weights, absolute.data(), scale.mutable_data<double>().data());
  for (double& s : scale.mutable_data<double>()) s += 0x1p-102;
}

}  // namespace slide::ops
