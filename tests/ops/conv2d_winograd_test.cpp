#include "ops/conv2d/winograd/winograd_matrices.h"

#include <doctest/doctest.h>

#include <map>
#include <string_view>

#include "kernel_bounds.h"
#include "ops/conv2d/conv2d_op.h"

using namespace slide;
using test::Call;
using test::random_tensor;

namespace {

/// x, weight, bias and, if fused, a residual, random.
Call conv(const Shape& x, std::int64_t filters, const ops::Conv2dParams& params,
          const ops::Conv2dFusion& fusion = {}, double sigma = 1) {
  std::vector<Tensor> inputs = {random_tensor(x, 1, sigma), random_tensor({filters, x[1], 3, 3}, 2),
                                random_tensor({filters}, 3)};
  const auto op = std::make_shared<ops::Conv2dOp>(params, fusion);
  if (fusion.residual) {
    const std::vector<Shape> shapes = {x, inputs[1].shape(), inputs[2].shape()};
    const auto plain = std::make_shared<ops::Conv2dOp>(params, ops::Conv2dFusion{.gate = fusion.gate});
    inputs.push_back(random_tensor(plain->infer(shapes), 4));
  }
  return {std::move(inputs), [&](const std::vector<Value>& v) { return v[0].graph().add(op, v); }};
}

/// Checks all Winograd kernels of every level this CPU runs on a call, worth it or not: the stated bound,
/// guard words, unwritten elements, one thread against three. Returns how many.
int check_winograd(const Call& call, bool flush_denormals = false) {
  const Tensor exact = call.reference();
  const std::vector<Shape> shapes = call.input_shapes();
  const std::vector<Isa> levels = available_isas();
  std::vector<Tensor> inputs;
  for (const Tensor& t : call.inputs) inputs.push_back(t.to(DType::kF32));
  std::map<std::string_view, Tensor> scales;
  int count = 0;
  for (const Kernel* kernel : call.op->kernels()) {
    if (std::find(levels.begin(), levels.end(), kernel->isa()) == levels.end()) continue;
    if (!kernel->name().starts_with("conv2d.winograd")) continue;
    INFO(std::string(kernel->name()), " ", std::string(name_of(kernel->isa())), " ", call.op->attributes());
    std::optional<FlushDenormals> flush;
    if (flush_denormals) flush.emplace();
    set_thread_count(1);
    const std::vector<float> y = test::run_guarded(*kernel, call, inputs);
    set_thread_count(3);
    const std::vector<float> again = test::run_guarded(*kernel, call, inputs);
    set_thread_count(0);
    flush.reset();
    CHECK(std::memcmp(y.data(), again.data(), y.size() * sizeof(float)) == 0);
    const auto [scale, first] = scales.try_emplace(kernel->name(), DType::kF64, call.shape);
    if (first)  // the same at the other levels
      REQUIRE(kernel->error_scale(*call.op, call.inputs, exact, scale->second));
    CHECK(test::error_in_bounds(y, exact, scale->second,
                                kernel->error_factor(*call.op, shapes) * kernel->unit_roundoff()) <= 1);
    ++count;
  }
  return count;
}

ops::Conv2dParams padded(std::array<std::int64_t, 4> padding, std::array<std::int64_t, 2> dilation) {
  ops::Conv2dParams params;
  params.padding = padding;
  params.dilation = dilation;
  return params;
}

double rms_error(const std::vector<float>& y, const Tensor& exact) {
  double error = 0;
  double size = 0;
  for (std::size_t i = 0; i < y.size(); ++i) {
    const double e = exact.data<double>()[i];
    error += (static_cast<double>(y[i]) - e) * (static_cast<double>(y[i]) - e);
    size += e * e;
  }
  return std::sqrt(error / size);
}

}  // namespace

TEST_CASE("Winograd's matrices convolve every filter and input exactly, but for float64's roundings") {
  for (const int tile : {2, 4, 6}) {
    const ops::WinogradMatrices w = ops::winograd_matrices(ops::winograd_pairs(tile));
    const auto n = static_cast<std::size_t>(w.frequencies);
    REQUIRE(n == static_cast<std::size_t>(tile) + 2);
    for (std::size_t input = 0; input < n; ++input)
      for (std::size_t tap = 0; tap < 3; ++tap)
        for (std::size_t i = 0; i < static_cast<std::size_t>(tile); ++i) {
          double y = 0;
          for (std::size_t f = 0; f < n; ++f) y += w.at[i][f] * w.g[f][tap] * w.bt[f][input];
          CHECK(y == doctest::Approx(input == i + tap ? 1 : 0).epsilon(1e-12));
        }
  }
}

TEST_CASE("the transforms' coefficients, points and their powers, are float32 numbers") {
  for (const int tile : {2, 4, 6})
    for (const double p : ops::winograd_pairs(tile))
      for (int i = 1; i < std::max(tile, 3); ++i) {
        const double power = std::pow(p, i);
        CHECK(static_cast<double>(static_cast<float>(power)) == power);
      }
}

TEST_CASE("Winograd convolutions keep their bound on every size of image, and at its edges") {
  const auto all = 5 * test::whole_levels();  // F(2), F(4), F(6); F(2), F(4) of bfloat16
  for (std::int64_t side = 1; side <= 14; ++side) {
    INFO(side);
    CHECK(check_winograd(conv({1, 5, side, 15 - side}, 6, ops::Conv2dParams::same(3))) ==
          (side < 15 ? all : 0));
  }
  CHECK(check_winograd(conv({1, 3, 5, 251}, 2, ops::Conv2dParams::same(3))) == all);
  CHECK(check_winograd(conv({2, 7, 50, 47}, 9, ops::Conv2dParams::same(3))) == all);
}

TEST_CASE("Winograd convolutions keep their bound with any padding") {
  CHECK(check_winograd(conv({1, 4, 9, 11}, 5, {})) > 0);
  CHECK(check_winograd(conv({1, 4, 9, 11}, 5, padded({0, 2, 1, 0}, {1, 1}))) > 0);
  CHECK(check_winograd(conv({1, 4, 3, 2}, 5, padded({9, 14, 7, 21}, {1, 1}))) > 0);
  CHECK(check_winograd(conv({1, 4, 6, 5}, 5, padded({5, 31, 0, 0}, {2, 3}))) > 0);
}

TEST_CASE("Winograd convolutions keep their bound on channels that fill no panel, and over several parts") {
  for (const std::int64_t channels : {1L, 2L, 9L, 33L, 300L})
    for (const std::int64_t filters : {1L, 3L, 6L, 50L}) {
      INFO(channels, " ", filters);
      CHECK(check_winograd(conv({1, channels, 6, 5}, filters, ops::Conv2dParams::same(3))) > 0);
    }
}

TEST_CASE("Winograd convolutions keep their bound dilated, phases ragged and shorter than the dilation") {
  for (const std::int64_t dilation : {2L, 3L, 4L, 8L, 16L})
    for (const std::int64_t width : {7L, 32L, 53L}) {
      INFO(dilation, " ", width);
      CHECK(check_winograd(conv({1, 3, 29, width}, 4, ops::Conv2dParams::same(3, 1, dilation))) > 0);
    }
  CHECK(check_winograd(conv({2, 3, 30, 70}, 4, padded({3, 0, 1, 8}, {1, 5}))) > 0);
  CHECK(check_winograd(conv({1, 3, 30, 40}, 4, padded({3, 1, 1, 2}, {6, 1}))) > 0);
}

TEST_CASE("Winograd convolutions keep their bound where threads share a strip, have their own, or segments") {
  CHECK(check_winograd(conv({1, 12, 130, 131}, 10, ops::Conv2dParams::same(3))) > 0);
  CHECK(check_winograd(conv({1, 48, 18, 700}, 2, ops::Conv2dParams::same(3))) > 0);
  CHECK(check_winograd(conv({1, 48, 18, 703}, 2, ops::Conv2dParams::same(3, 1, 4))) > 0);
  CHECK(check_winograd(conv({1, 256, 10, 14}, 100, ops::Conv2dParams::same(3))) > 0);
}

TEST_CASE("Winograd convolutions of few tiles keep their bound, whatever tiles and channels are left over") {
  const auto relu6 = std::make_shared<const ops::UnaryOp>(ops::UnaryKind::kRelu6);
  for (const std::int64_t channels : {1L, 77L, 300L})
    for (const std::int64_t filters : {31L, 64L}) {
      INFO(channels, " ", filters);
      CHECK(check_winograd(conv({1, channels, 3, 10}, filters, ops::Conv2dParams::same(3))) > 0);
      CHECK(check_winograd(conv({1, channels, 13, 11}, filters, ops::Conv2dParams::same(3, 1, 2))) > 0);
    }
  CHECK(check_winograd(conv({2, 21, 22, 19}, 60, ops::Conv2dParams::same(3))) > 0);  // 110 tiles of F(2)
  CHECK(check_winograd(conv({1, 10, 40, 39}, 32, ops::Conv2dParams::same(3))) > 0);  // 100 of F(4)
  CHECK(check_winograd(conv({1, 10, 20, 20}, 32, ops::Conv2dParams::same(3, 1, 4))) > 0);
  CHECK(check_winograd(conv({1, 10, 20, 17}, 64, ops::Conv2dParams::same(3, 1, 8), {.gate = true})) > 0);
  CHECK(check_winograd(
            conv({1, 19, 14, 9}, 62, ops::Conv2dParams::same(3),
                 {.relu_input = true, .residual = true, .residual_last = true, .activation = relu6})) > 0);
}

TEST_CASE("Winograd convolutions of few tiles keep their bound where weights are transformed by each run") {
  const auto relu6 = std::make_shared<const ops::UnaryOp>(ops::UnaryKind::kRelu6);
  const ops::Conv2dParams same = ops::Conv2dParams::same(3);
  CHECK(check_winograd(conv({1, 300, 13, 18}, 124, same)) > 0);
  CHECK(check_winograd(conv({1, 130, 19, 9}, 256, ops::Conv2dParams::same(3, 1, 2), {.gate = true})) > 0);
  CHECK(check_winograd(
            conv({1, 512, 8, 8}, 64, same, {.relu_input = true, .residual = true, .activation = relu6})) > 0);
}

namespace {

void check_same_filters(std::int64_t filters, bool bf16) {
  const Call many = conv({1, 300, 9, 12}, filters, ops::Conv2dParams::same(3));
  Call few = conv({1, 300, 9, 12}, 33, ops::Conv2dParams::same(3));
  for (std::size_t k = 1; k < 3; ++k) {
    const std::span<double> to = few.inputs[k].mutable_data<double>();
    std::ranges::copy(many.inputs[k].data<double>().subspan(0, to.size()), to.begin());
  }
  const auto result = [](const Call& call, const Kernel& kernel) {
    std::vector<Tensor> inputs;
    for (const Tensor& t : call.inputs) inputs.push_back(t.to(DType::kF32));
    return test::run_guarded(kernel, call, inputs);
  };
  const std::vector<Isa> levels = available_isas();
  for (const Kernel* kernel : many.op->kernels()) {
    if (std::find(levels.begin(), levels.end(), kernel->isa()) == levels.end()) continue;
    if (!kernel->name().starts_with("conv2d.winograd")) continue;
    if (kernel->precision() == Precision::kBf16 && !bf16) continue;
    INFO(std::string(kernel->name()), " ", std::string(name_of(kernel->isa())));
    const std::vector<float> all = result(many, *kernel), some = result(few, *kernel);
    CHECK(std::equal(some.begin(), some.end(), all.begin()));
  }
}

}  // namespace

TEST_CASE(
    "a filter's result is the same with filters or tiles as lanes, its weights transformed before or late") {
  check_same_filters(64, true);    // fill panels of lanes, which 33 do not
  check_same_filters(124, false);  // late; then of bfloat16, which rounds the weights before, too
}

TEST_CASE("Winograd convolutions fuse what a planner asks for") {
  const auto relu6 = std::make_shared<const ops::UnaryOp>(ops::UnaryKind::kRelu6);
  const auto elu = std::make_shared<const ops::UnaryOp>(ops::UnaryKind::kElu, 1.0);
  const std::vector<ops::Conv2dFusion> fusions = {
      {.relu_input = true},
      {.residual = true},
      {.gate = true},
      {.activation = relu6},
      {.relu_input = true, .residual = true, .activation = elu},
      {.relu_input = true, .gate = true},
      {.residual = true, .gate = true, .activation = relu6},
  };
  for (const ops::Conv2dFusion& fusion : fusions)
    for (const std::int64_t dilation : {1L, 2L, 16L}) {
      INFO(text_of(fusion), " dilation ", dilation);
      CHECK(check_winograd(conv({1, 6, 21, 38}, 10, ops::Conv2dParams::same(3, 1, dilation), fusion)) > 0);
      CHECK(check_winograd(conv({2, 6, 5, 6}, 62, ops::Conv2dParams::same(3, 1, dilation), fusion)) > 0);
    }
}

TEST_CASE("Winograd's bound holds where sums cancel, over a large range, and for denormals") {
  Call wide = conv({1, 40, 9, 13}, 7, ops::Conv2dParams::same(3));
  std::mt19937 generator(15);
  for (std::size_t k = 0; k < 2; ++k)
    for (double& v : wide.inputs[k].mutable_data<double>())
      v = std::ldexp(v, static_cast<int>(generator() % 60) - 30);
  CHECK(check_winograd(wide) > 0);

  Call cancelling = conv({1, 40, 9, 13}, 3, ops::Conv2dParams::same(3));
  const std::span<double> x = cancelling.inputs[0].mutable_data<double>();
  const std::span<double> w = cancelling.inputs[1].mutable_data<double>();
  for (std::size_t i = 0; i < x.size() / 2; ++i) x[x.size() / 2 + i] = x[i];
  for (std::size_t o = 0; o < 3; ++o)
    for (std::size_t i = 0; i < 180; ++i) w[o * 360 + 180 + i] = -w[o * 360 + i];
  CHECK(check_winograd(cancelling) > 0);

  for (const bool flush : {false, true})
    for (const int exponent : {-100, -130}) {
      Call small = conv({1, 8, 6, 20}, 8, ops::Conv2dParams::same(3));
      for (std::size_t k = 0; k < 3; ++k)
        for (double& v : small.inputs[k].mutable_data<double>())
          v = static_cast<double>(static_cast<float>(std::ldexp(v, k == 0 ? exponent : -20)));
      CHECK(check_winograd(small, flush) > 0);
    }
}

TEST_CASE("a Winograd convolution reads nothing but its image") {
  // The image lies between NaNs, which would spoil every tile they reach.
  const Call call = conv({1, 3, 11, 13}, 4, ops::Conv2dParams::same(3));
  const Tensor plain = call.inputs[0].to(DType::kF32);
  std::vector<float> memory(plain.data<float>().size() + 128, std::numeric_limits<float>::quiet_NaN());
  std::ranges::copy(plain.data<float>(), memory.begin() + 64);
  const std::vector<Tensor> inputs = {Tensor::view(DType::kF32, plain.shape(), memory.data() + 64),
                                      call.inputs[1].to(DType::kF32), call.inputs[2].to(DType::kF32)};
  const std::vector<Tensor> plain_inputs = {plain, inputs[1], inputs[2]};
  const std::vector<Isa> levels = available_isas();
  for (const Kernel* kernel : call.op->kernels()) {
    if (std::find(levels.begin(), levels.end(), kernel->isa()) == levels.end()) continue;
    if (!kernel->name().starts_with("conv2d.winograd")) continue;
    CHECK(test::run_guarded(*kernel, call, inputs) == test::run_guarded(*kernel, call, plain_inputs));
  }
}

TEST_CASE("Winograd's error is a few times that of a direct convolution, and F(6) is never chosen unasked") {
  const Call call = conv({1, 64, 24, 24}, 16, ops::Conv2dParams::same(3));
  const std::vector<Shape> shapes = call.input_shapes();
  const Tensor exact = call.reference();
  std::vector<Tensor> inputs;
  for (const Tensor& t : call.inputs) inputs.push_back(t.to(DType::kF32));
  bool direct_seen = false;
  for (const Kernel* kernel : call.op->kernels()) {
    if (kernel->isa() != detected_isa()) continue;
    if (kernel->name() == "conv2d.gemm") direct_seen = true;
    if (kernel->name() == "conv2d.winograd6") CHECK(direct_seen);  // the first that can is taken
    if (!kernel->name().starts_with("conv2d.winograd")) continue;
    const double error = rms_error(test::run_guarded(*kernel, call, inputs), exact);
    INFO(std::string(kernel->name()), " ", error);
    // In units of 2^-24: 2.7, 8 and 35 as measured; {0, ±1, ±2, ∞} would give F(4) 20. Of bfloat16, which
    // rounds two factors and hardly anything else, in units of 2^-8: 1.1 and 3.1.
    const std::map<std::string_view, double> limits = {{"conv2d.winograd2", 4},
                                                       {"conv2d.winograd4", 11},
                                                       {"conv2d.winograd2_bf16", 1.5},
                                                       {"conv2d.winograd4_bf16", 4},
                                                       {"conv2d.winograd6", 50}};
    const double limit = limits.at(kernel->name());
    CHECK(error < limit * kernel->unit_roundoff());
    CHECK(kernel->macs(*call.op, shapes, call.shape) < 0.45 * call.op->macs(shapes, call.shape));
  }
}
