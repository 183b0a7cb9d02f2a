#include "graphs/subject.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <functional>

#include "runtime/fast_executor.h"
#include "runtime/reference_executor.h"

using namespace slide;
using namespace slide::graphs;

namespace {

// W = 240: the matte counts within 4 pixels, gaps of 2 are closed.
constexpr std::int64_t kH = 60, kW = 240;
constexpr std::size_t kPlane = kH * kW;

using Function = std::function<double(double x, double y)>;

Tensor map_of(const Function& f) {
  Tensor t(DType::kF64, {1, 1, kH, kW});
  for (std::size_t i = 0; i < kPlane; ++i)
    t.mutable_data<double>()[i] = f(static_cast<double>(i % kW), static_cast<double>(i / kW));
  return t;
}

/// A subject of one colour from column 120 on, alpha rising over four pixels, before a wall of another.
double soft_edge(double x, double /*y*/) { return std::clamp((x - 117.3) / 5, 0.0, 1.0); }
constexpr double kFront[] = {0.75, 0.25, 0.5}, kBehind[] = {0.125, 0.5, 0.875};

Tensor mixture(const Tensor& matte) {
  Tensor t(DType::kF64, {1, 3, kH, kW});
  for (std::size_t i = 0; i < 3 * kPlane; ++i) {
    const double a = matte.data<double>()[i % kPlane];
    t.mutable_data<double>()[i] = a * kFront[i / kPlane] + (1 - a) * kBehind[i / kPlane];
  }
  return t;
}

/// All maps of find_subject(), in float64.
struct Found {
  Graph graph;
  NamedTensors inputs;
  std::unique_ptr<ReferenceExecutor> run;

  Found(const Function& disparity, const Function& matte)
      : inputs{{"D", map_of(disparity)}, {"M", map_of(matte)}, {"I", mixture(map_of(matte))}} {
    const SubjectRim rim = find_subject(graph.input("I", {1, 3, kH, kW}), graph.input("D", {1, 1, kH, kW}),
                                        graph.input("M", {1, 1, kH, kW}));
    graph.output("e", rim.agreement);
    graph.output("p", rim.moves);
    graph.output("D'", rim.disparity);
    graph.output("opaque", rim.opaque);
    graph.output("front", rim.front);
    graph.output("behind", rim.behind);
    graph.output("clear", rim.clear);
    run = std::make_unique<ReferenceExecutor>(graph, WeightMap());
    run->run(inputs);
  }
  [[nodiscard]] double at(const char* name, std::size_t x, std::size_t channel = 0) const {
    return run->tensor(name).data<double>()[channel * kPlane + 30 * kW + x];
  }
};

}  // namespace

TEST_CASE("where disparity jumps a pixel from the matte's edge it comes to jump at the subject's layer") {
  for (const double off : {-1.0, 1.0}) {
    CAPTURE(off);
    const Found found([&](double x, double) { return x < 120 + off ? 0.25 : 0.875; }, soft_edge);
    for (std::size_t x = 100; x < 140; ++x) {
      CAPTURE(x);
      // Alpha is above 0.02 from column 118 on; the layer is two pixels wider; alpha is above 0.98 from 123
      // on.
      CHECK(found.at("D'", x) == doctest::Approx(x < 116 ? 0.25 : 0.875).epsilon(1e-3));
      CHECK(found.at("opaque", x) == doctest::Approx(x < 123 ? 0.25 : 0.875).epsilon(1e-3));
      // The rim, with the pixel where the matte jumps to 0.14, is 117 to 122; four pixels more count.
      CHECK(found.at("e", x) == (x >= 113 && x <= 126 ? 1 : 0));
      CHECK(found.at("p", x) == (x >= 116 && x <= 126 ? 1 : 0));
    }
  }
}

TEST_CASE("in the rim both layers have colours of their own") {
  const Found found([](double x, double) { return x < 120 ? 0.0 : 1.0; }, soft_edge);
  for (std::size_t x = 112; x < 130; ++x)
    for (std::size_t c = 0; c < 3; ++c) {
      CAPTURE(x);
      const double a = soft_edge(static_cast<double>(x), 0);
      // What foreground_colours() leaves in this mixture, a hundredth, and what dividing by 1 - alpha makes
      // of it.
      if (x >= 116) CHECK(std::fabs(found.at("front", x, c) - kFront[c]) < 0.01);
      if (a <= 0.9) CHECK(std::fabs(found.at("behind", x, c) - kBehind[c]) < 0.01 * a / (1 - a) + 1e-12);
      CHECK(found.at("clear", x) == doctest::Approx(std::clamp((0.9 - a) / 0.4, 0.0, 1.0)));
    }
}

TEST_CASE("a matte that disparity does not share changes nothing") {
  const std::pair<const char*, Function> disparities[] = {
      {"a slope", [](double x, double) { return 0.5 * x / kW; }},
      {"the subject is behind", [](double x, double) { return x < 120 ? 1.0 : 0.0; }},
      {"an edge elsewhere", [](double x, double) { return x < 60 ? 0.0 : 1.0; }}};
  for (const auto& disparity : disparities) {
    CAPTURE(disparity.first);
    const Found found(disparity.second, soft_edge);
    CHECK(max_abs(found.run->tensor("e")) == 0);
    CHECK(max_abs_difference(found.run->tensor("D'"), found.inputs.at("D")) == 0);
    CHECK(max_abs_difference(found.run->tensor("front"), found.inputs.at("I")) == 0);
    CHECK(max_abs_difference(found.run->tensor("behind"), found.inputs.at("I")) == 0);
  }
}

TEST_CASE("the subject's rim in float32 is that of float64") {
  const Found found([](double x, double) { return x < 121 ? 0.25 : 0.875; }, soft_edge);
  FastExecutor fast(found.graph, WeightMap());
  fast.run(found.inputs);
  for (const char* name : {"e", "p", "D'", "opaque", "clear"})
    CHECK(max_abs_difference(fast.tensor(name), found.run->tensor(name)) <= 1e-6);
  // foreground_colours()'s own bound for its 68 steps, and a division by up to a tenth.
  CHECK(max_abs_difference(fast.tensor("front"), found.run->tensor("front")) <= 0x1p-24 * 60 * 68);
  CHECK(max_abs_difference(fast.tensor("behind"), found.run->tensor("behind")) <= 0x1p-24 * 60 * 68 * 10);
}
