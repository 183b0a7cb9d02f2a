#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string_view>
#include <vector>

#include "runtime/graph.h"
#include "runtime/weights.h"

namespace slide::graphs {

/// What a model's graph is built for.
struct BuildOptions {
  std::int64_t height = 0;  ///< of the input
  std::int64_t width = 0;
  /// The weights it will run with: for some models their shapes decide what the graph is. Null: the defaults.
  const WeightSource* weights = nullptr;
  /// The weights are those that the layers use, also where the authors' code would transform them after
  /// loading (FBA's weight standardisation): so they are in golden files.
  bool weights_as_used = false;
};

/// How the size that a model works at follows from an image's.
struct SizeRule {
  std::int64_t multiple = 1;  ///< both sides are multiples of it
  std::int64_t upper_bound =
      0;                    ///< the longer side is brought to this, the aspect kept; 0: the image's own size
  std::int64_t square = 0;  ///< both sides are this, whatever the aspect; 0: no such rule
};

/// One network that can be built by name.
struct Model {
  std::string_view name;
  std::string_view description;
  std::vector<std::string_view> inputs;   ///< names of the graph's inputs
  std::vector<std::string_view> outputs;  ///< what the graph's outputs "0", "1", ... are
  SizeRule size;                          ///< what is usual; any size that fits `multiple` can be built
  /// Beginnings of names of tensors that the authors' files hold though their forward pass does not read
  /// them.
  std::vector<std::string_view> unread;
  std::unique_ptr<Graph> (*build)(const BuildOptions& options);
};

/// All models.
[[nodiscard]] std::span<const Model> catalogue();

/// The model of that name. Throws Error(kUsage) listing the names there are.
[[nodiscard]] const Model& find_model(std::string_view name);

/// The graph of a model, its outputs named "0", "1", ... and its intermediate values tapped under the names
/// of the authors' modules. Throws Error(kUsage) if the size does not fit the model, Error(kBadWeights) if
/// the shapes of the weights fit no variant of it.
[[nodiscard]] std::unique_ptr<Graph> build_model(std::string_view name, const BuildOptions& options);

}  // namespace slide::graphs
