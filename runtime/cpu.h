#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace slide {

/// The instruction-set levels that kernels are compiled for, each including the ones before it on x86.
/// On AArch64 there is kNeon only.
enum class Isa : int {
  kBaseline = 0,  ///< SSE2 on x86-64; also the portable scalar code
  kAvx2,          ///< AVX2 + FMA
  kAvx512,        ///< AVX-512 F, BW, DQ, VL
  kAvx512Bf16,    ///< kAvx512 + BF16 + VNNI
  kNeon,          ///< AArch64 Advanced SIMD
};

/// "baseline", "avx2", "avx512", "avx512bf16", "neon".
[[nodiscard]] std::string_view name_of(Isa isa) noexcept;
[[nodiscard]] std::optional<Isa> isa_from_name(std::string_view name) noexcept;

/// The highest level this CPU (and operating system) runs.
[[nodiscard]] Isa detected_isa() noexcept;

/// Every level this CPU runs, lowest first.
[[nodiscard]] std::vector<Isa> available_isas();

/// The level in use: the one set by set_isa(), else the environment variable SLIDE_ISA, else detected_isa().
/// Throws Error(kUsage) if SLIDE_ISA names an unknown level or one this CPU does not run.
[[nodiscard]] Isa active_isa();

/// Forces a level for this process. Throws Error(kUsage) if this CPU does not run it.
void set_isa(Isa isa);

}  // namespace slide
