#include "ops/attention/contextual_attention.h"

#include <doctest/doctest.h>

#include "judge.h"
#include "kernel_bounds.h"
#include "runtime/error.h"
#include "runtime/safetensors.h"

using namespace slide;
using test::Call;
using test::random_tensor;

namespace {

Call attention(std::vector<Tensor> inputs, const ops::ContextualAttentionParams& params = {}) {
  return {std::move(inputs), [&](const std::vector<Value>& v) {
            return ops::contextual_attention(v[0], v[1], v[2], params,
                                             v.size() > 3 ? std::optional(v[3]) : std::nullopt);
          }};
}

Tensor filled(const Shape& shape, double value) {
  Tensor t(DType::kF64, shape);
  std::ranges::fill(t.mutable_data<double>(), value);
  return t;
}

/// A mask of zeros with ones in rows [y0, y1) and columns [x0, x1).
Tensor hole(std::int64_t height, std::int64_t width, std::int64_t y0, std::int64_t y1, std::int64_t x0,
            std::int64_t x1) {
  Tensor t = Tensor::zeros(DType::kF64, {1, 1, height, width});
  for (std::int64_t y = y0; y < y1; ++y)
    for (std::int64_t x = x0; x < x1; ++x)
      t.mutable_data<double>()[static_cast<std::size_t>(y * width + x)] = 1;
  return t;
}

}  // namespace

TEST_CASE("contextual attention agrees with the authors' PyTorch module") {
  const SafetensorsFile golden =
      SafetensorsFile::open(SLIDE_TEST_DATA "/ops/contextual_attention.safetensors");
  for (const std::string name : {"hole_inside", "general_fuse", "no_hole"}) {
    INFO(name);
    const Call call = attention({golden.tensor(name + ".foreground"), golden.tensor(name + ".background"),
                                 golden.tensor(name + ".mask"), golden.tensor(name + ".fuse_weight")});
    const Tensor expected = golden.tensor(name + ".expected");
    CHECK(max_abs_difference(call.reference(), expected) <= 1e-12 * max_abs(expected));
  }
}

TEST_CASE("without a fuse weight attention fuses along the diagonal") {
  const Tensor x = random_tensor({1, 3, 8, 10}, 1);
  const Tensor mask = hole(16, 20, 4, 10, 4, 12);
  const Tensor identity = Tensor::from<double>({1, 1, 3, 3}, std::vector<double>{1, 0, 0, 0, 1, 0, 0, 0, 1});
  CHECK(max_abs_difference(attention({x, x, mask}).reference(),
                           attention({x, x, mask, identity}).reference()) == 0);
}

TEST_CASE("attention to a constant gives that constant, less at the border where fewer patches overlap") {
  // The mask's ring keeps patches that reach over the border from being used; the scores of the others, over
  // 300 after scaling, leave no weight for them in the softmax either.
  Tensor ring = filled({1, 1, 12, 16}, 1.0);
  for (std::size_t y = 2; y < 10; ++y)
    for (std::size_t x = 2; x < 14; ++x) ring.mutable_data<double>()[y * 16 + x] = 0;
  const Tensor features = filled({1, 2, 12, 16}, 3.0);
  const Tensor result = attention({features, features, ring}).reference();
  for (std::size_t i = 0; i < 2 * 12 * 16; ++i) {
    const std::size_t y = i / 16 % 12;
    const std::size_t x = i % 16;
    const double overlap = (y == 0 || y == 11 ? 0.5 : 1.0) * (x == 0 || x == 15 ? 0.5 : 1.0);
    CHECK(result.data<double>()[i] == doctest::Approx(3 * overlap).epsilon(1e-12));
  }
}

TEST_CASE("a hole over everything leaves nothing to attend to") {
  const Tensor x = random_tensor({1, 2, 8, 8}, 3);
  CHECK(max_abs(attention({x, x, filled({1, 1, 16, 16}, 1.0)}).reference()) == 0);
}

TEST_CASE("one position attends to itself whatever its score") {
  // h = w = 1: the softmax of one value is 1, and the one patch is pasted where it came from, divided by
  // four.
  const Tensor f = random_tensor({1, 3, 2, 2}, 4);
  const Tensor b = random_tensor({1, 3, 2, 2}, 5);
  const Tensor y = attention({f, b, filled({1, 1, 2, 2}, 0)}).reference();
  for (std::size_t i = 0; i < 12; ++i) CHECK(y.data<double>()[i] == b.data<double>()[i] / 4);
}

TEST_CASE("every kernel of contextual attention keeps its bound") {
  const auto levels = test::whole_levels();
  struct Case {
    const char* what;
    Shape features;
    Tensor mask;
    ops::ContextualAttentionParams params;
    double sigma;
  };
  const Case cases[] = {
      {"a hole inside", {1, 5, 12, 18}, hole(24, 36, 8, 16, 10, 24), {}, 1.0},
      {"no hole", {1, 3, 16, 8}, hole(16, 8, 0, 0, 0, 0), {}, 1.0},
      {"nothing but hole", {1, 2, 8, 8}, hole(8, 8, 0, 8, 0, 8), {}, 1.0},
      {"one row of positions", {1, 3, 2, 20}, hole(4, 40, 0, 4, 8, 16), {}, 1.0},
      {"one column of positions", {1, 3, 20, 2}, hole(20, 2, 4, 8, 0, 2), {}, 1.0},
      {"one position", {1, 4, 2, 2}, hole(2, 2, 0, 0, 0, 0), {}, 1.0},
      {"steep scores", {1, 8, 10, 14}, hole(10, 14, 2, 6, 4, 8), {3, 2, 100.0, 3}, 10.0},
      {"flat scores", {1, 4, 10, 14}, hole(10, 14, 2, 6, 4, 8), {}, 1e-6},
      {"other sizes", {1, 3, 15, 18}, hole(15, 18, 3, 6, 3, 9), {5, 3, 10.0, 5}, 1.0},
      {"no fusing", {1, 3, 8, 10}, hole(8, 10, 2, 4, 2, 4), {1, 1, 10.0, 1}, 1.0},
  };
  for (const Case& c : cases) {
    INFO(c.what);
    const Tensor f = random_tensor(c.features, 6, c.sigma);
    const Tensor b = random_tensor(c.features, 7, c.sigma);
    const Tensor fuse = random_tensor({1, 1, c.params.fuse, c.params.fuse}, 8, 0.5);
    CHECK(check_kernels(attention({f, b, c.mask}, c.params)) == levels);
    CHECK(check_kernels(attention({b, b, c.mask, fuse}, c.params)) == levels);
    CHECK(check_kernels(attention({f, b, c.mask}, c.params), true) == levels);
  }
}

TEST_CASE("attention holds where products of features are beyond float32") {
  for (const double size : {1e15, 1e30}) {
    const Tensor f = random_tensor({1, 3, 8, 12}, 71, size);
    const Tensor b = random_tensor({1, 3, 8, 12}, 72, size);
    test::judge(attention({f, b, hole(16, 24, 4, 10, 6, 14)}));
  }
}

TEST_CASE("contextual attention says what does not fit") {
  const auto shapes = [](const Shape& f, const Shape& b, const Shape& mask) {
    return attention({filled(f, 0), filled(b, 0), filled(mask, 0)});
  };
  CHECK_THROWS_WITH_AS(shapes({1, 2, 7, 8}, {1, 2, 7, 8}, {1, 1, 7, 8}),
                       "layer contextual_attention: attention needs features 1xCxHxW with sides that are "
                       "multiples of 2, not 1x2x7x8",
                       Error);
  CHECK_THROWS_WITH_AS(
      shapes({1, 2, 8, 8}, {1, 2, 8, 8}, {1, 1, 12, 8}),
      "layer contextual_attention: a mask of shape 1x1x12x8 is no whole multiple of the features, "
      "1x2x8x8",
      Error);
  CHECK_THROWS_AS(shapes({1, 2, 8, 8}, {1, 3, 8, 8}, {1, 1, 8, 8}), Error);
}
