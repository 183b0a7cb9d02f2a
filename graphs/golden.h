#pragma once

#include <functional>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "graphs/formula_weights.h"
#include "runtime/graph.h"
#include "runtime/run.h"
#include "runtime/safetensors.h"

namespace slide::graphs {

/// How far one tensor of a run is from a golden one.
struct GoldenError {
  std::string name;      ///< "0", "1", ... for outputs, the module for intermediate tensors
  bool output = false;   ///< an output (stored in float64), else an intermediate tensor (stored in float32)
  double magnitude = 0;  ///< the golden tensor's largest
  double error = 0;      ///< largest difference, as part of the magnitude; infinite where only one is NaN
};

/// A golden file: one run of the authors' own implementation in float64.
///
/// Tensors input.NAME, output.N, tap.MODULE, param.NAME; metadata `network`, `salt` and `scales` (see
/// FormulaWeights). Our own, smaller files have the metadata `strides`: a JSON object that gives for some
/// tensors a number N, where every N-th element is stored, in row-major order, from the first one on.
class Golden {
 public:
  /// Throws Error(kBadWeights) for a file that is no safetensors file, Error(kBadInput) if it is no golden
  /// file.
  explicit Golden(SafetensorsFile file);
  static Golden open(const std::string& path) { return Golden(SafetensorsFile::open(path)); }

  /// The model's name in the catalogue.
  [[nodiscard]] const std::string& network() const noexcept { return network_; }
  [[nodiscard]] const std::string& description() const noexcept { return file_.description(); }
  /// The weights of the run.
  [[nodiscard]] FormulaWeights weights() const { return FormulaWeights(file_); }

  /// The network's graph at the size of the golden inputs, for weights that are used as they are. Throws
  /// Error(kBadInput) if it has not the inputs, outputs and taps that the file has tensors for.
  [[nodiscard]] std::unique_ptr<Graph> build(const WeightSource& weights) const;
  /// The inputs, in the graph's shapes.
  [[nodiscard]] NamedTensors inputs(const Graph& graph) const;
  /// The modules whose results the file holds.
  [[nodiscard]] std::set<std::string> taps() const;

  /// Compares all outputs and intermediate tensors. `result` gives a run's tensor by the name of an output or
  /// tap. Throws Error(kBadInput) if one has not as many elements as the golden tensor stands for.
  [[nodiscard]] std::vector<GoldenError> compare(
      const std::function<Tensor(const std::string&)>& result) const;

 private:
  [[nodiscard]] GoldenError compare_tensor(const TensorInfo& stored, const std::string& name,
                                           const Tensor& result) const;

  SafetensorsFile file_;
  std::string network_;
  std::map<std::string, std::int64_t, std::less<>> strides_;
};

}  // namespace slide::graphs
