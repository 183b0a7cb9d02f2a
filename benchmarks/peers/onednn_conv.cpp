// Single convolution layers, ours and oneDNN's (Debian: libdnnl-dev) in turns in one process: medians,
// arithmetic of the definition per second, and the largest error against float64. oneDNN is timed in its own
// blocked layouts, the reorders at both ends left out; ours from and to planar tensors.
//   onednn_conv [--threads N] [--rounds N] [--json]

#include <omp.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <dnnl.hpp>
#include <functional>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "graphs/formula_weights.h"
#include "ops/check.h"
#include "ops/conv2d/conv2d.h"
#include "runtime/error.h"
#include "runtime/fast_executor.h"
#include "runtime/reference_executor.h"
#include "runtime/threads.h"

namespace {

using namespace slide;

struct Layer {
  const char* name;
  std::int64_t channels, filters, kernel, height, width, stride, dilation;
};

constexpr Layer kLayers[] = {
    {"3x3, 256 to 256, 56x56", 256, 256, 3, 56, 56, 1, 1},
    {"3x3, 256 to 256, 96x96", 256, 256, 3, 96, 96, 1, 1},
    {"3x3, 64 to 64, 160x160", 64, 64, 3, 160, 160, 1, 1},
    {"3x3, 192 to 384, 64x64", 192, 384, 3, 64, 64, 1, 1},
    {"3x3 dilated by 4, 192 to 384, 64x64", 192, 384, 3, 64, 64, 1, 4},
    {"1x1, 1024 to 256, 24x24", 1024, 256, 1, 24, 24, 1, 1},
    {"7x7 stride 2, 3 to 64, 384x384", 3, 64, 7, 384, 384, 2, 1},
};

/// One way to compute a layer; the times of its runs.
struct Contender {
  std::string name;
  std::function<void()> run;
  std::function<Tensor()> result;
  std::vector<double> milliseconds{};
};

/// A layer's tensors, and its result in float64.
struct Problem {
  explicit Problem(const Layer& l) {
    const Value x = graph.input("x", {1, l.channels, l.height, l.width});
    const Value weight = graph.parameter("weight", {l.filters, l.channels, l.kernel, l.kernel});
    const Value bias = graph.parameter("bias", {l.filters});
    const Value y = ops::conv2d(x, weight, bias, ops::Conv2dParams::same(l.kernel, l.stride, l.dilation));
    graph.output("y", y);
    output = y.shape();
    input = Tensor(DType::kF32, x.shape());
    const std::span<float> values = input.mutable_data<float>();
    for (std::size_t i = 0; i < values.size(); ++i)
      values[i] = static_cast<float>(graphs::formula_unit("x", i + 1));
    ReferenceExecutor reference(graph, weights);
    reference.run({{"x", input}});
    expected = reference.tensor("y");
  }

  Graph graph;
  graphs::FormulaWeights weights = graphs::FormulaWeights::made_up();
  Tensor input, expected;
  Shape output;
};

Contender ours(const Problem& p, Precision precision) {
  FastOptions options;
  options.precision = precision;
  const auto executor = std::make_shared<FastExecutor>(p.graph, p.weights, options);
  const NamedTensors inputs = {{"x", p.input}};
  return {.name = "SLIDE " + std::string(name_of(precision)),
          .run = [executor, inputs] { executor->run(inputs); },
          .result = [executor] { return executor->tensor("y"); }};
}

/// A planar float32 tensor as oneDNN memory, and back.
class Planar {
 public:
  Planar(const dnnl::engine& engine, dnnl::stream& stream) : engine_(engine), stream_(stream) {}

  [[nodiscard]] dnnl::memory to(const Tensor& t, const dnnl::memory::desc& wanted) {
    dnnl::memory planar(descriptor(t.shape()), engine_);
    std::ranges::copy(t.data<float>(), static_cast<float*>(planar.get_data_handle()));
    dnnl::memory blocked(wanted, engine_);
    dnnl::reorder(planar, blocked).execute(stream_, planar, blocked);
    stream_.wait();
    return blocked;
  }
  [[nodiscard]] Tensor from(dnnl::memory blocked, const Shape& shape) {
    dnnl::memory planar(descriptor(shape), engine_);
    dnnl::reorder(blocked, planar).execute(stream_, blocked, planar);
    stream_.wait();
    const std::span<const float> values(static_cast<const float*>(planar.get_data_handle()),
                                        static_cast<std::size_t>(shape.count()));
    return Tensor::from<float>(shape, values);
  }

  static dnnl::memory::dims dims(const Shape& shape) {
    const auto extents = shape.extents();
    return {extents.begin(), extents.end()};
  }

 private:
  static dnnl::memory::desc descriptor(const Shape& shape) {
    using Tag = dnnl::memory::format_tag;
    return {dims(shape), dnnl::memory::data_type::f32, shape.rank() == 4 ? Tag::nchw : Tag::x};
  }
  const dnnl::engine& engine_;
  dnnl::stream& stream_;
};

/// oneDNN's convolution by an algorithm; nothing if it has none for the layer.
std::optional<Contender> onednn(const Problem& p, const Layer& l, dnnl::algorithm algorithm,
                                dnnl::memory::data_type type, const std::string& name,
                                const dnnl::engine& engine, dnnl::stream& stream) {
  using dnnl::memory;
  const Tensor weight = *p.weights.find("weight", {l.filters, l.channels, l.kernel, l.kernel});
  const Tensor bias = *p.weights.find("bias", {l.filters});
  const auto any = [](const Shape& shape, memory::data_type t) {
    return memory::desc(Planar::dims(shape), t, memory::format_tag::any);
  };
  const std::int64_t pad = l.dilation * (l.kernel / 2);
  dnnl::convolution_forward::primitive_desc chosen;
  try {
    const dnnl::convolution_forward::desc wanted(
        dnnl::prop_kind::forward_inference, algorithm, any(p.input.shape(), type), any(weight.shape(), type),
        any(bias.shape(), memory::data_type::f32), any(p.output, memory::data_type::f32),
        {l.stride, l.stride}, {l.dilation - 1, l.dilation - 1}, {pad, pad}, {pad, pad});
    chosen = dnnl::convolution_forward::primitive_desc(wanted, engine);
  } catch (const dnnl::error&) {
    return std::nullopt;
  }
  Planar planar(engine, stream);
  const dnnl::convolution_forward convolution(chosen);
  const memory y(chosen.dst_desc(), engine);
  const std::unordered_map<int, memory> arguments = {
      {DNNL_ARG_SRC, planar.to(p.input, chosen.src_desc())},
      {DNNL_ARG_WEIGHTS, planar.to(weight, chosen.weights_desc())},
      {DNNL_ARG_BIAS, planar.to(bias, chosen.bias_desc())},
      {DNNL_ARG_DST, y}};
  return Contender{.name = name + ", " + chosen.impl_info_str(),
                   .run =
                       [convolution, arguments, &stream] {
                         convolution.execute(stream, arguments);
                         stream.wait();
                       },
                   .result = [y, &p, &engine, &stream] { return Planar(engine, stream).from(y, p.output); }};
}

std::vector<Contender> contenders(const Problem& p, const Layer& l, const dnnl::engine& engine,
                                  dnnl::stream& stream) {
  using Type = dnnl::memory::data_type;
  std::vector<Contender> all;
  for (const Precision precision : {Precision::kFp32, Precision::kBf16, Precision::kInt8})
    all.push_back(ours(p, precision));
  const auto add = [&](dnnl::algorithm algorithm, Type type, const char* name) {
    if (auto found = onednn(p, l, algorithm, type, name, engine, stream)) all.push_back(std::move(*found));
  };
  add(dnnl::algorithm::convolution_direct, Type::f32, "oneDNN fp32 direct");
  add(dnnl::algorithm::convolution_winograd, Type::f32, "oneDNN fp32 Winograd");
  add(dnnl::algorithm::convolution_direct, Type::bf16, "oneDNN bf16 direct");
  return all;
}

nlohmann::json measure(const Layer& l, int rounds, const dnnl::engine& engine, dnnl::stream& stream) {
  const Problem p(l);
  std::vector<Contender> all = contenders(p, l, engine, stream);
  for (const Contender& c : all) c.run();
  for (int round = 0; round < rounds; ++round)
    for (Contender& c : all) {
      const auto start = std::chrono::steady_clock::now();
      c.run();
      const auto end = std::chrono::steady_clock::now();
      c.milliseconds.push_back(std::chrono::duration<double, std::milli>(end - start).count());
    }
  const double flop = 2.0 * static_cast<double>(p.output.count() * l.channels * l.kernel * l.kernel);
  nlohmann::json results = nlohmann::json::array();
  for (Contender& c : all) {
    std::ranges::sort(c.milliseconds);
    const double ms = c.milliseconds[c.milliseconds.size() / 2];
    results.push_back({{"name", c.name},
                       {"ms", ms},
                       {"gflops", 1e-6 * flop / ms},
                       {"max_error", ops::relative_error(c.result(), p.expected)}});
  }
  return {{"layer", l.name}, {"gflop", 1e-9 * flop}, {"threads", thread_count()}, {"results", results}};
}

int run(int argc, char** argv) {
  int threads = 0;
  int rounds = 21;
  bool json = false;
  CLI::App app("Single convolution layers beside oneDNN.");
  app.add_option("--threads", threads, "0: one a core")->check(CLI::Range(0, 1024));
  app.add_option("--rounds", rounds, "runs of each, in turns")->check(CLI::Range(1, 10000));
  app.add_flag("--json", json, "print JSON");
  CLI11_PARSE(app, argc, argv);
  set_thread_count(threads);
  omp_set_num_threads(thread_count());  // oneDNN's
  const dnnl::engine engine(dnnl::engine::kind::cpu, 0);
  dnnl::stream stream(engine);
  nlohmann::json all = nlohmann::json::array();
  for (const Layer& l : kLayers) {
    all.push_back(measure(l, rounds, engine, stream));
    if (json) continue;
    std::printf("%s (%.2f GFLOP, %d threads)\n", l.name, all.back()["gflop"].get<double>(), thread_count());
    for (const auto& r : all.back()["results"])
      std::printf("  %8.2f ms %8.1f GFLOP/s  max error %.1e  %s\n", r["ms"].get<double>(),
                  r["gflops"].get<double>(), r["max_error"].get<double>(),
                  r["name"].get<std::string>().c_str());
  }
  if (json) std::cout << all.dump(1) << "\n";
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  try {
    return run(argc, argv);
  } catch (const std::exception& e) {
    std::cerr << "onednn_conv: " << e.what() << "\n";
    return 6;
  }
}
