#include "ops/judge.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "ops/case_file.h"
#include "ops/check.h"
#include "ops/npy.h"
#include "runtime/cpu.h"
#include "runtime/error.h"
#include "runtime/plan.h"
#include "tests/temporary_folder.h"

using namespace slide;
using ops::Judgement;
using ops::Unit;

namespace {

/// Numbers in [-1, 1) that differ from element to element.
std::vector<float> noise(std::size_t count, std::uint32_t seed = 1) {
  std::vector<float> values(count);
  for (float& v : values) {
    seed = seed * 1664525u + 1013904223u;
    v = static_cast<float>(static_cast<std::int32_t>(seed)) * 0x1p-31F;
  }
  return values;
}

Tensor floats(const Shape& shape, const std::vector<float>& values) {
  return Tensor::from<float>(shape, std::span<const float>(values));
}

/// A 1×1 convolution of `channels`, with what it gives in float32, summed from first to last.
struct Sums {
  ops::OperatorCase c;
  std::vector<float> y;
};

Sums sums_of(std::int64_t channels, std::int64_t filters, std::int64_t height, std::int64_t width) {
  const auto n = static_cast<std::size_t>(channels);
  const auto area = static_cast<std::size_t>(height * width);
  const std::vector<float> x = noise(n * area);
  const std::vector<float> w = noise(n * static_cast<std::size_t>(filters), 7);
  std::vector<float> b = noise(static_cast<std::size_t>(filters), 9);
  for (float& v : b) v += std::copysign(1.0F, v);
  Sums s;
  s.c.op = "conv2d";
  s.c.inputs = {{"x", floats({1, channels, height, width}, x)},
                {"weight", floats({filters, channels, 1, 1}, w)},
                {"bias", floats({filters}, b)}};
  for (std::size_t f = 0; f < static_cast<std::size_t>(filters); ++f)
    for (std::size_t i = 0; i < area; ++i) {
      float sum = b[f];
      for (std::size_t k = 0; k < n; ++k) sum += w[f * n + k] * x[k * area + i];
      s.y.push_back(sum);
    }
  s.c.expected = floats({1, filters, height, width}, s.y);
  return s;
}

Judgement judged(const Sums& s, Unit unit = Unit::kFp32) {
  return ops::judge(s.c, floats(s.c.expected.shape(), s.y), unit);
}

bool says(const Judgement& j, const std::string& part) {
  return ops::text_of(j).find(part) != std::string::npos;
}

}  // namespace

TEST_CASE("where terms of both signs go beyond float32, a sum may be lost, and only there") {
  const float most = std::numeric_limits<float>::max();
  const auto judged = [](const std::vector<float>& x, float y) {
    const auto n = static_cast<std::int64_t>(x.size());
    ops::OperatorCase c;
    c.op = "conv2d";
    c.inputs = {{"x", floats({1, n, 1, 1}, x)},
                {"weight", floats({1, n, 1, 1}, std::vector<float>(x.size(), 1.0F))}};
    c.expected = floats({1, 1, 1, 1}, {0});
    return ops::judge(c, floats({1, 1, 1, 1}, {y}), Unit::kFp32).passed();
  };
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const float infinity = std::numeric_limits<float>::infinity();
  const std::vector<float> both = {most, most, -most, -most, -most / 2};
  CHECK(judged(both, nan));
  CHECK(judged(both, infinity));
  CHECK(judged(both, -most / 2));
  CHECK_FALSE(judged(both, most));
  const std::vector<float> one = {most, most, -most / 2};
  CHECK(judged(one, infinity));
  CHECK_FALSE(judged(one, nan));
  CHECK_FALSE(judged(one, -infinity));
}

TEST_CASE("a float32 sum of 4,608 terms is right, and its error is as large as predicted") {
  const Judgement j = judged(sums_of(4608, 2, 3, 5));
  CHECK(j.passed());
  CHECK(j.elements == 30);
  CHECK(j.rms < 3 * j.expected_rms);
  CHECK(j.rms > 0);
}

TEST_CASE("an error in small results is found beside large ones") {
  Sums s = sums_of(8, 2, 4, 4);
  Tensor weight = s.c.inputs[1].second;
  for (std::size_t k = 0; k < 8; ++k) weight.mutable_data<float>()[k] *= 1e7F;
  for (std::size_t i = 0; i < 16; ++i) {
    const auto b = s.c.inputs[2].second.data<float>()[0];
    float sum = b;
    for (std::size_t k = 0; k < 8; ++k)
      sum += weight.data<float>()[k] * s.c.inputs[0].second.data<float>()[k * 16 + i];
    s.y[i] = sum;
  }
  CHECK(judged(s).passed());
  for (std::size_t i = 16; i < 32; ++i) s.y[i] *= 1.1F;
  const Judgement j = judged(s);
  CHECK(j.wrong == 16);
  CHECK(says(j, "only the last channel, 1"));
  CHECK(says(j, "1.1 times what they should be"));
  REQUIRE(j.first);
  CHECK(j.first->index == std::vector<std::int64_t>{0, 1, 0, 0});
  CHECK(j.first->actual == doctest::Approx(1.1 * j.first->expected));
}

TEST_CASE("what wrong elements have in common is told") {
  const Sums good = sums_of(5, 32, 8, 9);
  Sums s = good;
  const auto at = [](std::size_t f, std::size_t y, std::size_t x) { return (f * 8 + y) * 9 + x; };
  for (std::size_t f = 0; f < 32; ++f)
    for (std::size_t y = 0; y < 8; ++y) s.y[at(f, y, 8)] = 0;
  CHECK(says(judged(s), "only the last column, 8"));
  s = good;
  for (std::size_t i = 0; i < 72; ++i) s.y[at(30, 0, 0) + i] = -7;
  CHECK(says(judged(s), "only channel 30"));
  s = good;
  for (std::size_t f = 0; f < 32; ++f)
    for (std::size_t x = 0; x < 9; ++x) s.y[at(f, 1, x)] = s.y[at(f, 5, x)] = 9;
  CHECK(says(judged(s), "only every 4th row, from 1"));
  s = good;
  for (std::size_t i = 0; i + 1 < s.y.size(); ++i) s.y[i] = good.y[i + 1];
  CHECK(says(judged(s), "what belongs one column further on"));
  s = good;
  for (std::size_t f = 0; f < 32; ++f)
    for (std::size_t i = 0; i < 72; ++i) s.y[f * 72 + i] -= s.c.inputs[2].second.data<float>()[f];
  CHECK(says(judged(s), "without the bias"));
  s = good;
  s.y[17] = std::numeric_limits<float>::quiet_NaN();
  CHECK(says(judged(s), "1 of the wrong elements are NaN"));
  CHECK(judged(s).wrong == 1);
  CHECK(judged(good).patterns.empty());
}

TEST_CASE("other shapes and types are told plainly") {
  const Sums s = sums_of(2, 2, 2, 3);
  const Judgement j = ops::judge(s.c, floats({1, 2, 3, 2}, s.y), Unit::kFp32);
  CHECK_FALSE(j.passed());
  CHECK(j.problem == "the shape is 1x2x3x2, it should be 1x2x2x3");
  CHECK_THROWS_AS((void)ops::judge(s.c, Tensor::zeros(DType::kI32, {1, 2, 2, 3}), Unit::kFp32), Error);
}

TEST_CASE("rounded products are right in their own unit only") {
  Sums s = sums_of(2, 2, 3, 5);
  std::ranges::fill(s.c.inputs[2].second.mutable_data<float>(), 0.0F);  // exact, it would hide the products
  const Tensor x = s.c.inputs[0].second.to(DType::kBF16).to(DType::kF32);
  const Tensor w = s.c.inputs[1].second.to(DType::kBF16).to(DType::kF32);
  for (std::size_t f = 0; f < 2; ++f)
    for (std::size_t i = 0; i < 15; ++i) {
      float sum = s.c.inputs[2].second.data<float>()[f];
      for (std::size_t k = 0; k < 2; ++k) sum += w.data<float>()[f * 2 + k] * x.data<float>()[k * 15 + i];
      s.y[f * 15 + i] = sum;
    }
  CHECK(judged(s, Unit::kBf16).passed());
  CHECK(judged(s, Unit::kInt8).passed());
  CHECK_FALSE(judged(s, Unit::kFp32).passed());
  CHECK_FALSE(judged(s, Unit::kTf32).passed());
}

TEST_CASE("an array of NumPy's is read, and what is none is refused by name") {
  const TemporaryFolder folder;
  const auto write = [&](const std::string& header, std::size_t bytes) {
    std::string text = std::string("\x93NUMPY\x01", 7) + '\0';
    text += static_cast<char>(header.size());
    text += '\0';
    text += header;
    const float values[] = {1, 2, 3, 4, 5, 6};
    text.append(reinterpret_cast<const char*>(values), bytes);
    write_bytes(folder.file("y.npy"), std::as_bytes(std::span(text)));
    return ops::read_npy(folder.file("y.npy"));
  };
  const Tensor y = write("{'descr': '<f4', 'fortran_order': False, 'shape': (2, 3), }\n", 24);
  CHECK(y.shape() == Shape{2, 3});
  CHECK(y.data<float>()[4] == 5);
  CHECK(write("{'descr': '<f8', 'fortran_order': False, 'shape': (3,), }\n", 24).shape() == Shape{3});
  for (const char* header :
       {"{'descr': '<f4', 'fortran_order': True, 'shape': (2, 3), }\n",
        "{'descr': '>f4', 'fortran_order': False, 'shape': (2, 3), }\n",
        "{'descr': '<f4', 'fortran_order': False, 'shape': (2, 4), }\n",
        "{'descr': '<f4', 'fortran_order': False, 'shape': (2, -3), }\n",
        "{'descr': '<f4', 'fortran_order': False, 'shape': (99999999999, 99999999999), }\n",
        "{'descr': '<f4', 'fortran_order': False, 'shape': (2, 3\n", "{'descr': '<f4', 'shape': (2, 3)}", ""})
    CHECK_THROWS_AS(write(header, 24), Error);
  CHECK_THROWS_AS((void)ops::read_npy(folder.file("none")), Error);
}

TEST_CASE("every float32 kernel of this build is judged right on the shipped cases, by its rms error, too") {
  double largest = 0;
  int judged = 0;
  for (const char* folder : {SLIDE_TEST_DATA "/onnx_cases", SLIDE_TEST_DATA "/operator_cases"})
    for (const std::string& file : ops::case_files(folder)) {
      const ops::OperatorCase c = ops::read_case(file);
      Graph graph;
      std::vector<std::pair<std::string, Value>> inputs;
      for (const auto& [name, tensor] : c.inputs)
        inputs.emplace_back(name, graph.input(name, tensor.shape()));
      const Node& node = graph.node(ops::build_case(c.op, c.attributes, inputs).node());
      const bool single = std::ranges::count(graph.nodes(), NodeKind::kOp, &Node::kind) == 1;
      if (!single || node.inputs.size() != c.inputs.size()) continue;
      std::vector<Tensor> arguments;
      std::vector<Shape> shapes;
      for (const int j : node.inputs) {
        const auto found =
            std::ranges::find(c.inputs, graph.node(j).name, &std::pair<std::string, Tensor>::first);
        arguments.push_back(found->second);
        shapes.push_back(found->second.shape());
      }
      const ops::KernelTask task = ops::make_task(*node.op, arguments);
      for (const Kernel* kernel : node.op->kernels()) {
        if (kernel->precision() != Precision::kFp32 || !runs_at(kernel->isa(), detected_isa()) ||
            !kernel->supports(*node.op, shapes, node.shape))
          continue;
        const ops::KernelCheck check = ops::check_kernel(*kernel, task);
        const Judgement j = ops::judge(c, check.output, Unit::kFp32);
        INFO(file, " ", check.kernel, "\n", ops::text_of(j));
        CHECK(j.passed());
        if (j.rms > 0) largest = std::max(largest, j.rms / j.rms_limit);
        ++judged;
      }
    }
  CHECK(judged > 300);
  CHECK(largest > 0.1);  // or the limit would hold nobody to anything
}

TEST_CASE("a constant that is wrong in its fifth digit keeps every bound, but not the rms error's") {
  Sums s = sums_of(4608, 1, 3, 5);
  Tensor x = s.c.inputs[0].second;
  Tensor weight = s.c.inputs[1].second;
  for (float& v : x.mutable_data<float>()) v = std::fabs(v);  // nothing cancels
  for (float& v : weight.mutable_data<float>()) v = std::fabs(v);
  for (std::size_t i = 0; i < s.y.size(); ++i) {
    double sum = static_cast<double>(s.c.inputs[2].second.data<float>()[0]);
    for (std::size_t k = 0; k < 4608; ++k)
      sum += static_cast<double>(weight.data<float>()[k]) * static_cast<double>(x.data<float>()[k * 15 + i]);
    s.y[i] = static_cast<float>(sum);
  }
  CHECK(judged(s).passed());
  for (float& v : s.y) v *= 1 + 2e-5F;
  const Judgement j = judged(s);
  CHECK(j.wrong == 0);
  CHECK_FALSE(j.passed());
  CHECK(says(j, "WRONG: 0 of 15 elements"));
  CHECK(says(j, ": too large"));
}
