#include "graphs/calibrate.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "graphs/compare.h"
#include "graphs/photo_inputs.h"
#include "ops/conv2d/conv2d_op.h"
#include "ops/fusion/fusion.h"
#include "runtime/error.h"
#include "runtime/fast_executor.h"

namespace slide::graphs {
namespace {

/// The layers that have a kernel of 8-bit integers: node by key. A weight that two nodes read is one layer.
using Layers = std::map<std::string, std::vector<int>>;

Layers layers_of(const Graph& graph) {
  Calibration all;  // of no errors, so that the plan leaves nothing in float32 that has another kernel
  for (int i = 0; i < static_cast<int>(graph.nodes().size()); ++i)
    if (graph.node(i).kind == NodeKind::kOp)
      if (const std::string key = calibration_key(graph, i); !key.empty()) all.layers[key] = {{0, 1}, 0};
  Layers layers;
  const Plan plan = make_plan(
      graph, PlanOptions{.precision = Precision::kInt8, .calibration = &all, .only_precision = true});
  for (const PlanStep& step : plan.steps)
    if (step.kernel->precision() == Precision::kInt8)
      layers[calibration_key(graph, step.node)].push_back(step.node);
  return layers;
}

/// x as the convolution reads it.
Tensor convolved(const Op& op, const Tensor& x) {
  const auto* convolution = dynamic_cast<const ops::Conv2dOp*>(&op);
  if (convolution == nullptr || !convolution->fusion().relu_input) return x;
  Tensor rectified = x.clone();
  for (float& v : rectified.mutable_data<float>()) v = std::max(v, 0.0F);
  return rectified;
}

/// The nodes of whose tensors x is made.
std::vector<int> convolved_inputs(const Node& node) {
  const auto* convolution = dynamic_cast<const ops::Conv2dOp*>(node.op.get());
  if (convolution == nullptr || convolution->fusion().joined == 0) return {node.inputs[0]};
  return {node.inputs[0], node.inputs.back()};
}

/// One photo's graph and what its float32 run made.
struct Sample {
  std::unique_ptr<Graph> graph;  // fused
  NamedTensors inputs;
  Layers layers;
  std::vector<Tensor> outputs;
};

class Calibrator {
 public:
  Calibrator(const WeightSource& weights, const ProgressCallback& progress)
      : weights_(weights), progress_(progress) {}

  void add_sample(std::string_view model, const Tensor& photo, std::int64_t longer) {
    PhotoRun run = photo_run(model, photo, weights_, longer);
    Sample sample{ops::fuse(*run.graph), std::move(run.inputs), {}, {}};
    sample.layers = layers_of(*sample.graph);
    samples_.push_back(std::move(sample));
  }

  Calibration result() {
    total_ = static_cast<int>(samples_.size() * (1 + samples_[0].layers.size())) +
             static_cast<int>(samples_.size());
    std::map<std::string, Range> seen;
    each_input([&](const std::string& key, std::span<const float> values) {
      const auto [low, high] = std::minmax_element(values.begin(), values.end());
      Range& range = seen.try_emplace(key, Range{0, 0}).first->second;
      range = {std::min(range.low, *low), std::max(range.high, *high)};
    });
    std::map<std::string, ValueHistogram> histograms;
    for (const auto& [key, range] : seen)
      if (range.low < range.high) histograms.emplace(key, ValueHistogram(range.low, range.high));
    each_input([&](const std::string& key, std::span<const float> values) {
      if (const auto it = histograms.find(key); it != histograms.end()) it->second.add(values);
    });
    Calibration calibration;
    for (const auto& [key, histogram] : histograms) {
      const Range range = histogram.best_range();
      calibration.layers[key] = {range, error_of(key, range)};
    }
    return calibration;
  }

 private:
  /// Runs all samples in float32 and hands out what each layer reads, as it reads it.
  template <typename Use>
  void each_input(Use use) {
    for (Sample& sample : samples_) {
      FastExecutor fast(*sample.graph, weights_, {.keep_all = true});
      step("float32");
      fast.run(sample.inputs);
      sample.outputs.clear();
      for (const auto& output : sample.graph->outputs())
        sample.outputs.push_back(fast.tensor(output.second).clone());
      for (const auto& [key, nodes] : sample.layers)
        for (const int node : nodes) {
          const Node& reader = sample.graph->node(node);
          for (const int input : convolved_inputs(reader)) {
            const Node& source = sample.graph->node(input);
            const Tensor x = source.kind == NodeKind::kInput
                                 ? sample.inputs.find(source.name)->second.to(DType::kF32)
                                 : fast.tensor(input);
            use(key, convolved(*reader.op, x).data<float>());
          }
        }
    }
  }

  double error_of(const std::string& key, const Range& range) {
    Calibration alone;
    alone.layers[key] = {range, 0};
    double error = 0;
    bool known = false;
    for (const Sample& sample : samples_) {
      FastExecutor fast(*sample.graph, weights_,
                        {.precision = Precision::kInt8, .calibration = &alone, .only_precision = true});
      step(key);
      fast.run(sample.inputs);
      for (std::size_t i = 0; i < sample.outputs.size(); ++i) {
        if (max_abs(sample.outputs[i]) == 0) continue;  // nothing is relative to zeros
        known = true;
        error = std::max(error,
                         tensor_error(fast.tensor(sample.graph->outputs()[i].second), sample.outputs[i]).rms);
      }
    }
    return known && std::isfinite(error) ? std::min(error, 1.0) : 1.0;  // more than all of it is as bad
  }

  void step(const std::string& what) {
    if (progress_ && !progress_({done_, total_, what}))
      throw Error(ErrorKind::kCancelled, "cancelled while calibrating");
    ++done_;
  }

  const WeightSource& weights_;
  const ProgressCallback& progress_;
  std::vector<Sample> samples_;
  int done_ = 0, total_ = 0;
};

}  // namespace

ValueHistogram::ValueHistogram(float low, float high)
    : low_(low), high_(high), counts_(kCalibrationBins, 0) {}

void ValueHistogram::add(std::span<const float> values) {
  const double scale = kCalibrationBins / (high_ - low_);
  for (const float v : values)
    if (v != 0 && v >= low_ && v <= high_)
      counts_[std::min<std::size_t>(kCalibrationBins - 1, static_cast<std::size_t>((v - low_) * scale))] += 1;
}

double ValueHistogram::mean_square(double low, double high) const {
  const double width = (high_ - low_) / kCalibrationBins;
  const double step = (high - low) / 255;
  double sum = 0;
  for (std::size_t b = 0; b < counts_.size(); ++b) {
    if (counts_[b] == 0) continue;
    const double v = low_ + (static_cast<double>(b) + 0.5) * width;
    const double outside = v < low ? low - v : v > high ? v - high : 0;
    sum += counts_[b] * (outside > 0 ? outside * outside : step * step / 12);
  }
  return sum;
}

Range ValueHistogram::best_range() const {
  constexpr int kParts = 40;
  double low = low_;
  double high = high_;
  double least = mean_square(low, high);
  for (int i = low_ < 0 ? 1 : kParts; i <= kParts; ++i)
    for (int j = high_ > 0 ? 1 : kParts; j <= kParts; ++j) {
      const double square = mean_square(low_ * i / kParts, high_ * j / kParts);
      if (square >= least) continue;
      least = square;
      low = low_ * i / kParts;
      high = high_ * j / kParts;
    }
  return {static_cast<float>(low), static_cast<float>(high)};
}

namespace {

/// An image of the photo's size, for what photos seldom are: black, white, and a ramp from left to right.
Tensor plain_image(const Shape& shape, const std::function<float(std::int64_t x)>& value) {
  Tensor image(DType::kF32, shape);
  const std::span<float> pixels = image.mutable_data<float>();
  for (std::size_t i = 0; i < pixels.size(); ++i) pixels[i] = value(static_cast<std::int64_t>(i) % shape[3]);
  return image;
}

}  // namespace

Calibration calibrate(std::string_view model, const WeightSource& weights, std::span<const Tensor> photos,
                      std::int64_t longer, const ProgressCallback& progress) {
  if (photos.empty()) throw Error(ErrorKind::kUsage, "there is no photo to calibrate with");
  Calibrator calibrator(weights, progress);
  for (const Tensor& photo : photos) calibrator.add_sample(model, photo, longer);
  // Roundings that are the same all over an image do not average out, and a network's result may be small there.
  const Shape& shape = photos.front().shape();
  const auto ramp = [&](std::int64_t x) { return static_cast<float>(x) / static_cast<float>(shape[3]); };
  calibrator.add_sample(model, plain_image(shape, [](std::int64_t) { return 0.0F; }), longer);
  calibrator.add_sample(model, plain_image(shape, [](std::int64_t) { return 1.0F; }), longer);
  calibrator.add_sample(model, plain_image(shape, ramp), longer);
  return calibrator.result();
}

}  // namespace slide::graphs
