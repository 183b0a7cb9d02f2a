#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace slide {

/// What a CPU may have beyond its architecture's baseline. Each is found by itself; kernels need some of
/// them.
enum class CpuFeature : int {
  kAvx2 = 0,    ///< AVX2 and FMA
  kF16c,        ///< conversions of half precision
  kAvxVnni,     ///< 8-bit dot products of 256 bits, encoded without AVX-512
  kAvx512,      ///< AVX-512 F, BW, DQ, VL
  kAvx512Vnni,  ///< 8-bit dot products of 512 bits
  kAvx512Bf16,
  kAvx512Fp16,
  kAmxTile,  ///< tile registers that the operating system lets this process use
  kAmxBf16,
  kAmxInt8,
  kNeon,     ///< AArch64 Advanced SIMD
  kFp16,     ///< its arithmetic in half precision
  kDotProd,  ///< its 8-bit dot products
  kI8mm,     ///< its 8-bit matrix products
  kArmBf16,  ///< its bfloat16 dot and matrix products
};
inline constexpr int kCpuFeatures = 15;

/// "avx2", "f16c", "avx_vnni", "avx512", "avx512_vnni", "avx512_bf16", "avx512_fp16", "amx_tile", "amx_bf16",
/// "amx_int8", "neon", "fp16", "dotprod", "i8mm", "bf16".
[[nodiscard]] std::string_view name_of(CpuFeature feature) noexcept;

/// A set of features.
class CpuFeatures {
 public:
  constexpr CpuFeatures() noexcept = default;
  [[nodiscard]] constexpr bool has(CpuFeature f) const noexcept { return (bits_ & bit(f)) != 0; }
  [[nodiscard]] constexpr bool includes(CpuFeatures all) const noexcept { return (all.bits_ & ~bits_) == 0; }
  [[nodiscard]] constexpr CpuFeatures with(CpuFeature f) const noexcept {
    return CpuFeatures(bits_ | bit(f));
  }
  [[nodiscard]] constexpr CpuFeatures without(CpuFeature f) const noexcept {
    return CpuFeatures(bits_ & ~bit(f));
  }

 private:
  constexpr explicit CpuFeatures(std::uint32_t bits) noexcept : bits_(bits) {}
  static constexpr std::uint32_t bit(CpuFeature f) noexcept {
    return std::uint32_t{1} << static_cast<unsigned>(f);
  }
  std::uint32_t bits_ = 0;
};

/// The names, separated by a space each; "none" for an empty set.
[[nodiscard]] std::string text_of(CpuFeatures features);

/// The sets of features that kernels are compiled for. A larger number is a better level where both run.
enum class Isa : int {
  kBaseline = 0,  ///< SSE2 on x86-64; also the portable scalar code
  kAvx2,          ///< AVX2 + FMA
  kAvxVnni,       ///< kAvx2 + AVX-VNNI: 8-bit products only
  kAvx512,        ///< AVX-512 F, BW, DQ, VL
  kAvx512Vnni,    ///< kAvx512 + VNNI: 8-bit products only
  kAvx512Bf16,    ///< kAvx512Vnni + BF16
  kAmx,           ///< kAvx512Bf16 + AMX tiles: products of 8 and 16 bits only
  kNeon,          ///< AArch64 Advanced SIMD
  kNeonDot,       ///< kNeon + DotProd: 8-bit products only
  kNeonI8mm,      ///< kNeonDot + I8MM: 8-bit products only
  kNeonBf16,      ///< kNeonI8mm + BF16: products of 16 bits only
};
inline constexpr int kIsaLevels = 11;

/// "baseline", "avx2", "avxvnni", "avx512", "avx512vnni", "avx512bf16", "amx", "neon", "neondot", "neoni8mm",
/// "neonbf16".
[[nodiscard]] std::string_view name_of(Isa isa) noexcept;
[[nodiscard]] std::optional<Isa> isa_from_name(std::string_view name) noexcept;

/// What a level's kernels may use.
[[nodiscard]] CpuFeatures features_of(Isa isa) noexcept;

/// Whether a kernel compiled for `kernel` may run where `isa` is the level in use.
[[nodiscard]] bool runs_at(Isa kernel, Isa isa) noexcept;

/// What this CPU has and the operating system lets this process use. The first call asks the kernel for AMX.
[[nodiscard]] CpuFeatures detected_features() noexcept;

/// The best level whose features are all among those.
[[nodiscard]] Isa best_isa(CpuFeatures features) noexcept;

/// The best level that this CPU runs.
[[nodiscard]] Isa detected_isa() noexcept;

/// Every level this CPU runs, lowest first.
[[nodiscard]] std::vector<Isa> available_isas();

/// The level that a text names: that of a level ("avx512"), or the best without some features
/// ("avx512bf16,-avx512_vnni", "-avx_vnni"; without a level first, of all that this CPU has). Throws
/// Error(kUsage), naming `origin`, if the text is none or this CPU does not run the level.
[[nodiscard]] Isa isa_from_text(std::string_view text, const std::string& origin);

/// The level in use: the one set by set_isa(), else what the environment variable SLIDE_ISA names, else
/// detected_isa(). Throws as isa_from_text().
[[nodiscard]] Isa active_isa();

/// Forces a level for this process. Throws Error(kUsage) if this CPU does not run it.
void set_isa(Isa isa);

}  // namespace slide
