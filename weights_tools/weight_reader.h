#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "runtime/safetensors.h"

namespace slide {

/// A file of named tensors, whatever its format, read one tensor at a time.
class WeightReader {
 public:
  using Take = std::function<void(std::span<const std::byte>)>;

  WeightReader() = default;
  virtual ~WeightReader() = default;
  WeightReader(const WeightReader&) = delete;
  WeightReader& operator=(const WeightReader&) = delete;

  /// The path.
  [[nodiscard]] virtual const std::string& path() const = 0;
  /// "safetensors", "PyTorch zip" or "PyTorch stream".
  [[nodiscard]] virtual std::string format() const = 0;
  /// All tensors; those that share a storage follow one another, so that reading them in this order reads it
  /// once.
  [[nodiscard]] virtual const std::vector<TensorInfo>& tensors() const = 0;
  [[nodiscard]] virtual const Metadata& metadata() const = 0;
  /// Whether the file has checksums of its tensors' values.
  [[nodiscard]] virtual bool has_checksums() const = 0;
  /// Hands out the bytes of tensor i in row-major order, in blocks of whole elements of at most 1 MB. Throws
  /// Error(kBadWeights) if the file has a checksum of them that they do not match.
  virtual void for_each_block(std::size_t i, const Take& take) const = 0;
};

/// Opens a safetensors file or a PyTorch checkpoint, told apart by their first bytes. `key` chooses among
/// several sets of tensors in a checkpoint ("state_dict", "G", "model.ema"; "." is the outermost dictionary);
/// empty: the only one, or the one with a usual name. Throws Error(kBadWeights) if it is neither, or damaged,
/// or holds what it should not; see SafetensorsFile, ZipArchive, read_pickle.
[[nodiscard]] std::unique_ptr<WeightReader> open_weights(const std::string& path,
                                                         const std::string& key = "");

/// Tensor i as one tensor in memory.
[[nodiscard]] Tensor load(const WeightReader& reader, std::size_t i);

}  // namespace slide
