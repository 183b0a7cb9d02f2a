#include "runtime/sensitivity.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "runtime/constants.h"
#include "runtime/lifetime.h"

namespace slide {
namespace {

/// Mean and deviation of all channels of a graph's inputs.
struct Image {
  double mean, deviation;
};
constexpr Image kImages[] = {{0.5, 0.5}, {1, 0}, {-1, 0}, {0, 0}};

double average(std::span<const double> values) {
  return std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
}

std::size_t channels_of(const Shape& shape) {
  return shape.rank() >= 2 ? static_cast<std::size_t>(shape[1]) : 1;
}

/// The walk of all images through a graph.
class Walk {
 public:
  Walk(const Graph& graph, const std::vector<bool>& constant, const WeightSource& weights)
      : graph_(graph), constant_(constant), weights_(weights) {
    for (std::vector<NodeStatistics>& nodes : nodes_) nodes.resize(graph.nodes().size());
  }

  void visit(int i) {
    const Node& node = graph_.node(i);
    const auto at = static_cast<std::size_t>(i);
    if (node.kind == NodeKind::kInput)
      for (std::size_t k = 0; k < std::size(kImages); ++k) {
        const std::size_t channels = channels_of(node.shape);
        nodes_[k][at].output = {std::vector<double>(channels, kImages[k].mean),
                                std::vector<double>(channels, kImages[k].deviation * kImages[k].deviation)};
      }
    if (node.kind != NodeKind::kOp || constant_[at]) return;
    const std::vector<Shape> shapes = input_shapes(graph_, node);
    const auto* states = dynamic_cast<const StatesStatistics*>(node.op.get());
    std::vector<Tensor> constants(node.inputs.size());
    for (std::size_t j = 0; j < constants.size(); ++j)
      if (states != nullptr && constant_[static_cast<std::size_t>(node.inputs[j])])
        constants[j] = constant_value(graph_, weights_, node.inputs[j]);
    for (std::vector<NodeStatistics>& nodes : nodes_) {
      std::vector<ValueStatistics> inputs;
      for (const int j : node.inputs) inputs.push_back(nodes[static_cast<std::size_t>(j)].output);
      const StatisticsCall call{inputs, constants, shapes};
      nodes[at] = states != nullptr ? states->statistics(call) : handed_on(*node.op, call);
    }
  }

  [[nodiscard]] std::vector<double> result() const {
    std::vector<double> own(graph_.nodes().size(), 1);
    for (const std::vector<NodeStatistics>& nodes : nodes_)
      for (std::size_t i = 0; i < own.size(); ++i) own[i] = std::max(own[i], std::sqrt(nodes[i].own));
    return own;
  }

 private:
  const Graph& graph_;
  const std::vector<bool>& constant_;
  const WeightSource& weights_;
  std::vector<NodeStatistics> nodes_[std::size(kImages)];
};

}  // namespace

double ValueStatistics::square(std::size_t c) const {
  const std::size_t at = channels() == 1 ? 0 : c;
  return mean[at] * mean[at] + variance[at];
}

double ValueStatistics::square() const {
  double sum = 0;
  for (std::size_t c = 0; c < channels(); ++c) sum += square(c);
  return sum / static_cast<double>(channels());
}

double relative_square(double error, double size) noexcept {
  if (error == 0) return 0;
  constexpr double kMost = kMostSensitive * kMostSensitive;
  const double relative = error / size;
  return relative < kMost ? relative : kMost;  // NaN, too
}

ValueStatistics statistics_of(const Tensor& constant) {
  const Tensor wide = constant.to(DType::kF64);
  const std::span<const double> values = wide.data<double>();
  const std::size_t channels = channels_of(constant.shape());
  const std::size_t outer = constant.shape().rank() >= 2 ? static_cast<std::size_t>(constant.shape()[0]) : 1;
  const std::size_t inner = values.size() / (outer * channels);
  ValueStatistics s{std::vector<double>(channels, 0), std::vector<double>(channels, 0)};
  const auto each = [&](auto use) {
    for (std::size_t i = 0; i < values.size(); ++i) use(i / inner % channels, values[i]);
  };
  const double count = static_cast<double>(outer * inner);
  each([&](std::size_t c, double v) { s.mean[c] += v / count; });
  each([&](std::size_t c, double v) { s.variance[c] += (v - s.mean[c]) * (v - s.mean[c]) / count; });
  return s;
}

NodeStatistics handed_on(const Op& op, const StatisticsCall& call) {
  const std::size_t channels = channels_of(op.infer(call.shapes));
  NodeStatistics result;
  const auto first =
      std::ranges::find_if(call.inputs, [](const ValueStatistics& s) { return s.channels() > 0; });
  if (first == call.inputs.end()) {
    result.output = {std::vector<double>(channels, 0), std::vector<double>(channels, 1)};
  } else if (first->channels() == channels) {
    result.output = *first;
  } else {
    const double mean = average(first->mean);
    result.output = {std::vector<double>(channels, mean),
                     std::vector<double>(channels, std::max(0.0, first->square() - mean * mean))};
  }
  return result;
}

std::vector<double> find_sensitivities(const Graph& graph, const std::vector<bool>& constant,
                                       const WeightSource& weights) {
  require_fit(graph, weights);
  Walk walk(graph, constant, weights);
  for (int i = 0; i < static_cast<int>(graph.nodes().size()); ++i) walk.visit(i);
  weights.release();
  return walk.result();
}

}  // namespace slide
