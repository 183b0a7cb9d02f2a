// First the nearest known row within every column, by a sweep down and one up. Then row by row, for each run
// of unknown pixels: a column's known pixel is at a squared distance that is a parabola along the row, and
// the lower envelope of the parabolas says who is nearest (Meijster, Roerdink and Hesselink, "A general
// algorithm for computing distance transforms in linear time", 2000). The known pixels at both ends of a run
// are nearer than anything beyond them.

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <limits>
#include <vector>

#include "ops/common/elements.h"
#include "ops/fill/mirror_op.h"

namespace slide::ops {
namespace {

constexpr std::int64_t kColumnGrain = 128;
constexpr std::int64_t kRowGrain = 8;
// Rows of columns that know none above or below: farther away than any row, the latter still farther.
constexpr std::int32_t kNone = -(1 << 30);
constexpr std::int32_t kNoneBelow = (1 << 30) + (1 << 29);

/// rows[i, j]: the known row of column j nearest to i, the upper one of two; columns [begin, end).
void nearest_rows(const float* weight, const Nchw& s, std::int64_t begin, std::int64_t end,
                  std::int32_t* rows) {
  const std::int64_t count = end - begin;
  std::int32_t found[kColumnGrain];
  std::fill_n(found, count, kNone);
  for (std::int64_t i = 0; i < s.h; ++i)
    for (std::int64_t j = 0; j < count; ++j) {
      const std::int64_t at = i * s.w + begin + j;
      found[j] = weight[at] >= static_cast<float>(kKnown) ? static_cast<std::int32_t>(i) : found[j];
      rows[at] = found[j];
    }
  std::fill_n(found, count, kNoneBelow);
  for (std::int64_t i = s.h - 1; i >= 0; --i)
    for (std::int64_t j = 0; j < count; ++j) {
      const auto row = static_cast<std::int32_t>(i);
      const std::int64_t at = i * s.w + begin + j;
      const std::int32_t above = rows[at];
      found[j] = above == row ? row : found[j];
      rows[at] = found[j] - row < row - above ? found[j] : above;
    }
}

/// The known pixels nearest to those of a run of unknown ones in row i. Of equally near ones the first, row
/// by row: distances count as many times as there are pixels, and the number of the pixel is added.
class Envelope {
 public:
  /// `rows` is that row of nearest_rows().
  Envelope(const std::int32_t* rows, const Nchw& s, std::int64_t i) : rows_(rows), s_(s), i_(i) {}

  /// Makes it that of the columns first <= j < last, which are unknown.
  void find(std::int64_t first, std::int64_t last) {
    pieces_.clear();
    for (std::int64_t column = std::max<std::int64_t>(0, first - 1); column < std::min(s_.w, last + 1);
         ++column)
      if (rows_[column] != kNone) add({column, offset(column), first}, last);
  }
  /// Calls body(j, column) for all of them: the known pixel is that of the column.
  template <typename Body>
  void for_each(std::int64_t last, const Body& body) const {
    for (std::size_t k = 0; k < pieces_.size(); ++k) {
      const std::int64_t end = k + 1 < pieces_.size() ? pieces_[k + 1].from : last;
      for (std::int64_t j = pieces_[k].from; j < end; ++j) body(j, pieces_[k].column);
    }
  }

 private:
  /// From column `from` on that column's pixel is the nearest.
  struct Piece {
    std::int64_t column, offset, from;
  };

  [[nodiscard]] std::int64_t offset(std::int64_t column) const {
    const std::int64_t down = rows_[column] - i_;
    return down * down * s_.plane() + rows_[column] * s_.w + column;
  }
  /// A piece b further right than a is nearer than it from the first j > sum / slope on; for no j equally
  /// near.
  void add(Piece piece, std::int64_t last) {
    while (!pieces_.empty()) {
      const Piece& before = pieces_.back();
      const std::int64_t apart = piece.column - before.column;
      const std::int64_t slope = 2 * apart * s_.plane();
      const std::int64_t sum =
          apart * (before.column + piece.column) * s_.plane() + piece.offset - before.offset;
      if (sum >= slope * (last - 1)) return;
      if (sum >= slope * before.from) {
        piece.from = sum / slope + 1;
        break;
      }
      pieces_.pop_back();
    }
    pieces_.push_back(piece);
  }

  const std::int32_t* rows_;
  const Nchw& s_;
  std::int64_t i_;
  std::vector<Piece> pieces_;
};

std::int64_t mirrored(std::int64_t centre, std::int64_t t, std::int64_t size) {
  const std::int64_t far = std::abs(2 * centre - t);
  return std::min(far, 2 * (size - 1) - far);
}

class MirrorKnownKernel : public Kernel {
 public:
  [[nodiscard]] std::string_view name() const override { return "mirror_known.columns"; }
  [[nodiscard]] Isa isa() const override { return Isa::kBaseline; }
  [[nodiscard]] bool supports(const Op& /*op*/, std::span<const Shape> /*inputs*/,
                              const Shape& /*output*/) const override {
    return true;
  }
  [[nodiscard]] std::size_t scratch_bytes(const Op& /*op*/, std::span<const Shape> inputs,
                                          const Shape& /*output*/) const override {
    return static_cast<std::size_t>(nchw(inputs[0]).plane()) * sizeof(std::int32_t);
  }
  /// Values are copied.
  [[nodiscard]] double error_factor(const Op& /*op*/, std::span<const Shape> /*inputs*/) const override {
    return 0;
  }

  void run(const Op& /*op*/, std::span<const Tensor> inputs, Tensor& output,
           const KernelCall& call) const override {
    const Nchw s = nchw(inputs[0].shape());
    auto* rows = static_cast<std::int32_t*>(static_cast<void*>(call.scratch.data()));
    for (std::int64_t n = 0; n < s.n; ++n) {
      const float* weight = f32(inputs[1]) + n * s.plane();
      for_ranges(s.w, kColumnGrain,
                 [&](std::int64_t begin, std::int64_t end) { nearest_rows(weight, s, begin, end, rows); });
      const float* x = f32(inputs[0]) + n * s.c * s.plane();
      float* y = f32(output) + n * s.c * s.plane();
      // Every column knows a row or none; with none at all there is nothing to mirror at.
      const bool any = std::any_of(rows, rows + s.w, [](std::int32_t row) { return row != kNone; });
      for_ranges(s.h, kRowGrain, [&](std::int64_t begin, std::int64_t end) {
        for (std::int64_t i = begin; i < end; ++i) mirror_row(x, s, rows + i * s.w, i, any, y);
      });
    }
  }

 private:
  static void mirror_row(const float* x, const Nchw& s, const std::int32_t* rows, std::int64_t i, bool any,
                         float* y) {
    for (std::int64_t c = 0; c < s.c; ++c)
      std::copy_n(x + c * s.plane() + i * s.w, s.w, y + c * s.plane() + i * s.w);
    Envelope envelope(rows, s, i);
    for (std::int64_t j = 0; any && j < s.w;) {
      const std::int64_t first = j;
      while (j < s.w && rows[j] != i) ++j;
      if (j == first) {
        ++j;
        continue;
      }
      envelope.find(first, j);
      envelope.for_each(j, [&](std::int64_t at, std::int64_t column) {
        const std::int64_t from = mirrored(rows[column], i, s.h) * s.w + mirrored(column, at, s.w);
        for (std::int64_t c = 0; c < s.c; ++c) y[c * s.plane() + i * s.w + at] = x[c * s.plane() + from];
      });
    }
  }
};

const MirrorKnownKernel kMirror;
const Kernel* const kKernels[] = {&kMirror};

}  // namespace

std::span<const Kernel* const> MirrorKnownOp::kernels() const { return kKernels; }

}  // namespace slide::ops
