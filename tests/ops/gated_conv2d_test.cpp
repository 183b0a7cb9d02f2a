#include "ops/conv2d/gated_conv2d.h"

#include <doctest/doctest.h>

#include "kernel_bounds.h"
#include "runtime/error.h"

using namespace slide;
using test::Call;
using test::random_tensor;

namespace {

Call gated(std::vector<Tensor> inputs, const ops::Conv2dParams& params) {
  return {std::move(inputs), [&](const std::vector<Value>& v) {
            return ops::gated_conv2d(v[0], v[1], v.size() > 2 ? std::optional(v[2]) : std::nullopt, params);
          }};
}

}  // namespace

TEST_CASE("a gated convolution is elu of one half of the filters times sigmoid of the other") {
  const ops::Conv2dParams params = ops::Conv2dParams::same(3, 2);
  const std::vector<Tensor> inputs = {random_tensor({2, 3, 8, 9}, 1), random_tensor({10, 3, 3, 3}, 2),
                                      random_tensor({10}, 3)};
  const Call plain(inputs,
                   [&](const std::vector<Value>& v) { return ops::conv2d(v[0], v[1], v[2], params); });
  const Call call = gated(inputs, params);
  CHECK(call.shape == Shape{2, 5, 4, 5});
  const Tensor conv = plain.reference();
  const Tensor y = call.reference();
  for (std::size_t i = 0; i < 200; ++i) {
    const std::size_t feature = i / 100 * 200 + i % 100;
    const double a = conv.data<double>()[feature];
    const double g = conv.data<double>()[feature + 100];
    const double expected = (a > 0 ? a : std::exp(a) - 1) / (1 + std::exp(-g));
    CHECK(y.data<double>()[i] == doctest::Approx(expected).epsilon(1e-14));
  }
}

TEST_CASE("gates of weight zero are half open") {
  Tensor w = random_tensor({4, 2, 1, 1}, 4);
  for (std::size_t i = 4; i < 8; ++i) w.mutable_data<double>()[i] = 0;
  Tensor x = random_tensor({1, 2, 3, 3}, 5);
  for (double& v : x.mutable_data<double>()) v = std::fabs(v);
  for (double& v : w.mutable_data<double>()) v = std::fabs(v);
  const Tensor half_w = Tensor::from<double>({2, 2, 1, 1}, w.data<double>().first(4));
  const Call plain({x, half_w},
                   [](const std::vector<Value>& v) { return ops::conv2d(v[0], v[1], std::nullopt, {}); });
  const Tensor a = plain.reference();
  const Tensor y = gated({x, w}, {}).reference();
  for (std::size_t i = 0; i < 18; ++i) CHECK(y.data<double>()[i] == a.data<double>()[i] / 2);
}

TEST_CASE("the gated scale bounds what errors of the convolution do to the output") {
  // Moves feature and gate by c·u times their own scales, both ways, and asks that y moves by no more than
  // c·u times the gated scale; from small errors to the largest that the derivation allows, c·u = 1/64.
  for (const double size : {1e-6, 1e-3, 1.0 / 64})
    for (const double a : {-30.0, -3.0, -1e-3, 0.0, 1e-3, 0.5, 40.0})
      for (const double g : {-200.0, -20.0, -1.0, 0.0, 3.0, 50.0})
        for (const double spread : {1.0, 10.0, 1000.0}) {
          // One pixel, one channel: a and g each as the difference of two terms, which makes the scale
          // larger.
          const Tensor x = Tensor::from<double>({1, 2, 1, 1}, std::vector<double>{1, 1});
          const Tensor w = Tensor::from<double>(
              {2, 2, 1, 1}, std::vector<double>{a + spread, -spread, g + spread, -spread});
          const Call call = gated({x, w}, {});
          const Tensor y = call.reference();
          const double scale = call.error_scale(y).data<double>()[0];
          const double scale_a = std::fabs(a + spread) + spread;
          const double scale_g = std::fabs(g + spread) + spread;
          for (const double sign_a : {-1.0, 1.0})
            for (const double sign_g : {-1.0, 1.0}) {
              const double moved_a = a + sign_a * size * scale_a;
              const double moved_g = g + sign_g * size * scale_g;
              const double moved = (moved_a < 0 ? std::expm1(moved_a) : moved_a) / (1 + std::exp(-moved_g));
              INFO(a, " ", g, " ", spread, " ", size);
              CHECK(std::fabs(moved - y.data<double>()[0]) <= size * scale * (1 + 1e-9));
            }
        }
}

TEST_CASE("a gated convolution needs an even number of filters") {
  CHECK_THROWS_WITH_AS(
      gated({random_tensor({1, 2, 3, 3}, 1), random_tensor({3, 2, 1, 1}, 2)}, {}),
      "layer gated_conv2d: a gated convolution needs an even number of filters, the weight has "
      "shape 3x2x1x1",
      Error);
}

TEST_CASE("every kernel of the gated convolution keeps its bound") {
  struct Case {
    Shape x, weight;
    ops::Conv2dParams params;
    double sigma;  // of the weights
  };
  const Case cases[] = {
      {{1, 5, 9, 17}, {14, 5, 3, 3}, ops::Conv2dParams::same(3), 1.0},
      {{1, 6, 33, 20}, {24, 6, 5, 5}, ops::Conv2dParams::same(5, 2), 0.1},
      {{2, 4, 18, 19}, {2, 4, 3, 3}, ops::Conv2dParams::same(3, 1, 4), 1.0},
      {{1, 40, 6, 7}, {50, 40, 3, 3}, ops::Conv2dParams::same(3, 1, 16), 0.05},
      {{1, 8, 7, 21}, {12, 4, 3, 3}, ops::Conv2dParams::same(3, 1, 1, 2), 1.0},  // two groups
      {{1, 3, 1, 1}, {6, 3, 1, 1}, {}, 30.0},  // gates far open and far shut
      {{1, 3, 5, 50}, {6, 3, 1, 1}, {}, 30.0},
  };
  for (const Case& c : cases)
    for (const bool bias : {false, true}) {
      INFO(c.weight.text(), " bias ", bias);
      std::vector<Tensor> inputs = {random_tensor(c.x, 6), random_tensor(c.weight, 7, c.sigma)};
      if (bias) inputs.push_back(random_tensor({c.weight[0]}, 8));
      CHECK(check_kernels(gated(inputs, c.params)) >= test::whole_levels());
    }
}

TEST_CASE("the gated bound holds for denormals, flushed to zero or not") {
  for (const bool flush : {false, true})
    for (const double gate : {0.0, -60.0, -87.0, -100.0, -104.0}) {
      const Tensor x = random_tensor({1, 2, 4, 9}, 9);
      const Tensor w = random_tensor({4, 2, 1, 1}, 10, 1e-3);
      const Tensor bias = Tensor::from<double>({4}, std::vector<double>{1e-39, 1e5, gate, gate});
      CHECK(check_kernels(gated({x, w, bias}, {}), flush) > 0);
    }
}
