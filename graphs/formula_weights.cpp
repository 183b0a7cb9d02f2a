#include "graphs/formula_weights.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "runtime/error.h"
#include "runtime/threads.h"

namespace slide::graphs {
namespace {

std::uint64_t fnv1a(std::string_view text) noexcept {
  std::uint64_t hash = 0xcbf29ce484222325;
  for (const char c : text) hash = (hash ^ static_cast<unsigned char>(c)) * 0x100000001b3;
  return hash;
}

double unit(std::uint64_t hash, std::uint64_t i) noexcept {
  std::uint64_t z = hash + i * 0x9E3779B97F4A7C15;
  z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9;
  z = (z ^ (z >> 27)) * 0x94D049BB133111EB;
  z ^= z >> 31;
  return static_cast<double>(z >> 40) * 0x1p-23 - 1;
}

Tensor filled(const Shape& shape, float value) {
  Tensor t(DType::kF32, shape);
  std::ranges::fill(t.mutable_data<float>(), value);
  return t;
}

Tensor identity_matrix(const Shape& shape) {
  Tensor t = Tensor::zeros(DType::kF32, shape);
  const auto side = static_cast<std::size_t>(shape[-1]);
  for (std::size_t i = 0; i < std::min(side, static_cast<std::size_t>(shape[-2])); ++i)
    t.mutable_data<float>()[i * side + i] = 1;
  return t;
}

/// He initialisation, uniform: the variance 2 / fan-in.
float he_scale(const Shape& shape) {
  const double fan_in = static_cast<double>(shape.count()) / static_cast<double>(shape[0]);
  return static_cast<float>(std::sqrt(6 / fan_in));
}

}  // namespace

double formula_unit(std::string_view text, std::uint64_t i) noexcept { return unit(fnv1a(text), i); }

FormulaWeights::FormulaWeights(SafetensorsFile golden) {
  const Metadata& metadata = golden.metadata();
  const auto salt = metadata.find("salt");
  const auto scales = metadata.find("scales");
  if (salt == metadata.end() || scales == metadata.end())
    throw Error(ErrorKind::kBadInput,
                golden.description() + ": the metadata \"salt\" and \"scales\" of a golden file are missing");
  salt_ = salt->second;
  const auto json = nlohmann::json::parse(scales->second, nullptr, false);
  if (!json.is_object())
    throw Error(ErrorKind::kBadInput, golden.description() + ": the metadata \"scales\" is no JSON object");
  for (const auto& [name, scale] : json.items()) {
    if (!scale.is_number())
      throw Error(ErrorKind::kBadInput, golden.description() + ": the scale of " + name + " is no number");
    scales_[name] = scale.get<float>();
  }
  golden_ = std::move(golden);
}

FormulaWeights FormulaWeights::made_up(std::string salt) {
  FormulaWeights weights;
  weights.salt_ = std::move(salt);
  return weights;
}

std::string FormulaWeights::description() const {
  return golden_ ? "the formula weights of " + golden_->description() : "made-up weights";
}

std::optional<Tensor> FormulaWeights::find(std::string_view name, const Shape& wanted) const {
  if (!golden_) return made_up_tensor(name, wanted);
  if (const std::string stored = "param." + std::string(name); golden_->contains(stored))
    return golden_->tensor(stored);
  const auto scale = scales_.find(name);
  if (scale == scales_.end() || wanted.rank() < 2) return std::nullopt;
  return formula(name, wanted, scale->second, 0);
}

std::vector<std::string> FormulaWeights::golden_names() const {
  std::vector<std::string> names;
  for (const auto& entry : scales_) names.push_back(entry.first);
  if (golden_)
    for (const TensorInfo& info : golden_->tensors())
      if (info.name.starts_with("param.")) names.push_back(info.name.substr(6));
  return names;
}

Tensor FormulaWeights::made_up_tensor(std::string_view name, const Shape& shape) const {
  if (name.ends_with("fuse_weight") && shape.rank() >= 2) return identity_matrix(shape);
  const bool filters = shape.rank() == 4 || (shape.rank() == 2 && name.ends_with("weight"));
  if (filters && shape.count() > 0) return formula(name, shape, he_scale(shape), 0);
  if (name.ends_with("running_mean")) return filled(shape, 0);
  if (name.ends_with("running_var")) return filled(shape, 1);
  return formula(name, shape, 0.1F, name.ends_with("weight") ? 1.0F : 0.0F);
}

Tensor FormulaWeights::formula(std::string_view name, const Shape& shape, float scale, float offset) const {
  constexpr std::int64_t kBlock = 1 << 16;
  Tensor t(DType::kF32, shape);
  const std::span<float> out = t.mutable_data<float>();
  const std::uint64_t hash = fnv1a(salt_ + std::string(name));
  const std::int64_t count = shape.count();
  parallel_for((count + kBlock - 1) / kBlock, [&](std::int64_t block) {
    const std::int64_t end = std::min(count, (block + 1) * kBlock);
    for (std::int64_t i = block * kBlock; i < end; ++i)
      out[static_cast<std::size_t>(i)] =
          offset + static_cast<float>(unit(hash, static_cast<std::uint64_t>(i) + 1)) * scale;
  });
  return t;
}

}  // namespace slide::graphs
