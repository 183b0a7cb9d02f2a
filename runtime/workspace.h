#pragma once

#include <cstddef>

#include "runtime/tensor.h"

namespace slide {

/// Memory for the results of executors that run one after the other: as much as the largest of them needs,
/// once. One executor may use it at a time.
class Workspace {
 public:
  /// At least `bytes` bytes, 64-byte aligned, not initialised. Memory that is too small is given back first:
  /// what lay in it is lost. Throws Error(kOutOfMemory).
  [[nodiscard]] std::byte* reserve(std::size_t bytes) {
    if (bytes > memory_.bytes() || memory_.empty()) {
      memory_ = Tensor();
      memory_ = Tensor(DType::kU8, {static_cast<std::int64_t>(bytes)});
    }
    return memory_.mutable_raw().data();
  }
  /// Gives the memory back; the next reserve() makes new one.
  void release() noexcept { memory_ = Tensor(); }
  /// Where the memory lies; null if there is none.
  [[nodiscard]] const std::byte* data() const noexcept { return memory_.raw().data(); }
  [[nodiscard]] std::size_t bytes() const noexcept { return memory_.empty() ? 0 : memory_.bytes(); }

 private:
  Tensor memory_;
};

}  // namespace slide
