#pragma once

#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "runtime/graph.h"
#include "runtime/tensor.h"

namespace slide {

struct Calibration;

/// Where the values of a graph's parameters come from: a weight file, a checkpoint, a formula.
class WeightSource {
 public:
  virtual ~WeightSource() = default;
  /// What messages call it: a file name, say.
  [[nodiscard]] virtual std::string description() const = 0;
  /// The tensor of that name (any floating dtype), or nothing. The graph's shape is passed for sources that
  /// make tensors up; a source that has the tensor returns it as it is.
  [[nodiscard]] virtual std::optional<Tensor> find(std::string_view name, const Shape& wanted) const = 0;
  /// Throws Error(kBadWeights) naming source and tensor if the values of a tensor that find() returned are
  /// not those that were stored, or not all finite. May be called by several threads at once.
  virtual void check(std::string_view name, const Tensor& tensor) const;
  /// Says that the tensor's values will not be read soon. A source that can fetch them again gives their
  /// memory back to the system; tensors that find() returned stay valid.
  virtual void release(std::string_view /*name*/) const {}
  /// Says the same of all tensors.
  virtual void release() const {}
  /// The names it holds, in its own order; empty for sources that make tensors up.
  [[nodiscard]] virtual std::vector<std::string> names() const = 0;
  /// What calibration found for these weights (runtime/calibration.h); null if they were not calibrated.
  [[nodiscard]] virtual const Calibration* calibration() const { return nullptr; }
};

/// Tensors in memory by name.
class WeightMap : public WeightSource {
 public:
  explicit WeightMap(std::string description = "weights in memory") : description_(std::move(description)) {}
  void set(const std::string& name, Tensor tensor) { tensors_[name] = std::move(tensor); }
  [[nodiscard]] std::string description() const override { return description_; }
  [[nodiscard]] std::optional<Tensor> find(std::string_view name, const Shape& wanted) const override;
  [[nodiscard]] std::vector<std::string> names() const override;

 private:
  std::string description_;
  std::map<std::string, Tensor, std::less<>> tensors_;
};

/// How a source fits a graph.
struct WeightFit {
  std::vector<std::string> missing;      ///< parameters the source does not have
  std::vector<std::string> unexpected;   ///< tensors the graph does not use
  std::vector<std::string> wrong_shape;  ///< "name: file has 3x3, the graph needs 5x5"
  std::vector<std::string> wrong_dtype;  ///< "name: I64", where a floating type is needed
  /// Nothing missing or wrong; unexpected tensors are no hindrance.
  [[nodiscard]] bool usable() const noexcept {
    return missing.empty() && wrong_shape.empty() && wrong_dtype.empty();
  }
  /// One readable message, long lists shortened ("... and 12 more"); empty if all fits.
  [[nodiscard]] std::string message(const std::string& source) const;
};

/// Compares names, shapes and dtypes; reads no values. Batch norm's "num_batches_tracked" counters, which no
/// inference needs, are not reported as unexpected.
[[nodiscard]] WeightFit fit(const Graph& graph, const WeightSource& weights);

/// Throws Error(kBadWeights) with WeightFit::message() unless the fit is usable.
void require_fit(const Graph& graph, const WeightSource& weights);

/// The value of a parameter node, in the source's dtype. Throws Error(kBadWeights) if the source does not
/// have it in that shape, and as WeightSource::check() does.
[[nodiscard]] Tensor parameter(const Node& node, const WeightSource& weights);

/// The values of all parameters, by node index, after require_fit().
[[nodiscard]] std::map<int, Tensor> bind(const Graph& graph, const WeightSource& weights);

}  // namespace slide
