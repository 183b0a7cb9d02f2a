#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <string_view>

#include "runtime/safetensors.h"
#include "runtime/weights.h"

namespace slide::graphs {

/// The i-th number (i >= 1) of the sequence that belongs to a text: in [-1, 1), a multiple of 2^-23.
/// SplitMix64 (Steele, Lea, Flood, OOPSLA 2014) started at the text's 64-bit FNV-1a hash, its top 24 bits.
[[nodiscard]] double formula_unit(std::string_view text, std::uint64_t i) noexcept;

/// Weights that are a formula of their names, so that networks can be tested and timed without weight files.
///
/// A filter bank (rank 4), and in golden files any tensor of rank 2 or more that has a scale, is
/// float32(formula_unit(salt + name, 1...)) · float32(scale), the product rounded to float32.
class FormulaWeights : public WeightSource {
 public:
  /// Those of a golden file: salt and scales from its metadata, everything that is no filter bank from its
  /// tensors param.NAME. Names it does not know are missing. Throws Error(kBadInput) if the metadata cannot
  /// be read.
  explicit FormulaWeights(SafetensorsFile golden);

  /// For any network: filter banks and matrices scaled by √(6 / fan-in), which keeps the activations' size
  /// through ReLU layers; norms' weights in 1 ± 0.1, biases in ± 0.1, running means 0 and variances 1;
  /// contextual attention's fuse kernel the identity.
  static FormulaWeights made_up(std::string salt = "");

  [[nodiscard]] std::string description() const override;
  [[nodiscard]] std::optional<Tensor> find(std::string_view name, const Shape& wanted) const override;
  /// None: filter banks take the shape they are asked for.
  [[nodiscard]] std::vector<std::string> names() const override { return {}; }
  /// The names a golden file gives a value or a scale for.
  [[nodiscard]] std::vector<std::string> golden_names() const;

 private:
  FormulaWeights() = default;
  [[nodiscard]] Tensor made_up_tensor(std::string_view name, const Shape& shape) const;
  [[nodiscard]] Tensor formula(std::string_view name, const Shape& shape, float scale, float offset) const;

  std::string salt_;
  std::optional<SafetensorsFile> golden_;
  std::map<std::string, float, std::less<>> scales_;
};

}  // namespace slide::graphs
