#pragma once

#include "ops/gemm/conv2d_gemm.h"

namespace slide::ops {

/// A gated convolution in groups: features and gates lie in different groups, so the whole convolution comes
/// first, then the gate.
class Conv2dGroupedGate {
 public:
  static constexpr Precision kPrecision = Precision::kFp32;
  Conv2dGroupedGate(const Conv2dRoutines& routines, const Conv2dGeometry& geometry,
                    const Conv2dFusion& fusion);

  [[nodiscard]] static bool fits(const Conv2dGeometry& geometry, const Conv2dFusion& fusion) noexcept {
    return fusion.gate && geometry.groups > 1 && !fusion.upsamples();
  }

  [[nodiscard]] std::size_t packed_bytes() const noexcept { return convolution_.packed_bytes(); }
  void pack(const float* weight, std::byte* packed) const { convolution_.pack(weight, packed); }
  [[nodiscard]] std::size_t scratch_bytes() const noexcept;
  [[nodiscard]] double error_factor() const noexcept { return convolution_.error_factor(); }
  [[nodiscard]] double macs() const noexcept { return convolution_.macs(); }
  void run(const Conv2dArrays& arrays, std::span<std::byte> scratch) const;

 private:
  [[nodiscard]] std::size_t result_bytes() const noexcept;

  const Conv2dRoutines& routines_;
  Conv2dGeometry g_;
  Conv2dGemm convolution_;
  Conv2dEpilogue epilogue_;
};

}  // namespace slide::ops
