#include "runtime/cpu.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cstdlib>

#include "runtime/error.h"

#if defined(__x86_64__)
#include <cpuid.h>
#if defined(__linux__)
#include <sys/syscall.h>
#include <unistd.h>
#endif
#elif defined(__aarch64__) && defined(__linux__)
#include <asm/hwcap.h>
#include <sys/auxv.h>
#endif

namespace slide {
namespace {

constexpr std::array<std::string_view, kIsaLevels> kNames = {"baseline",   "avx2",       "avxvnni", "avx512",
                                                             "avx512vnni", "avx512bf16", "amx",     "neon",
                                                             "neondot",    "neoni8mm",   "neonbf16"};
constexpr std::array<std::string_view, kCpuFeatures> kFeatureNames = {
    "avx2",     "f16c",     "avx_vnni", "avx512", "avx512_vnni", "avx512_bf16", "avx512_fp16", "amx_tile",
    "amx_bf16", "amx_int8", "neon",     "fp16",   "dotprod",     "i8mm",        "bf16"};

std::atomic<int> forced{-1};

#if defined(__x86_64__)

/// Whether this process may use the tile registers: their state is large, and is saved only for those that
/// asked (Linux, Documentation/arch/x86/xstate.rst).
bool tiles_permitted() noexcept {
#if defined(__linux__) && defined(SYS_arch_prctl)
  constexpr int kRequestPermission = 0x1023, kTileData = 18;  // ARCH_REQ_XCOMP_PERM, XFEATURE_XTILEDATA
  return syscall(SYS_arch_prctl, kRequestPermission, kTileData) == 0;
#else
  return false;
#endif
}

CpuFeatures detect() noexcept {
  CpuFeatures found;
  const auto add = [&found](bool has, CpuFeature feature) {
    if (has) found = found.with(feature);
  };
  // These ask the operating system, too, for the state that it saves.
  add(__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma"), CpuFeature::kAvx2);
  add(__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
          __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl"),
      CpuFeature::kAvx512);
  unsigned a = 0, b = 0, c = 0, d = 0;
  const auto bit = [](unsigned word, unsigned n) { return (word >> n & 1U) != 0; };
  if (found.has(CpuFeature::kAvx2) && __get_cpuid(1, &a, &b, &c, &d) != 0) add(bit(c, 29), CpuFeature::kF16c);
  if (!found.has(CpuFeature::kAvx2) || __get_cpuid_count(7, 0, &a, &b, &c, &d) == 0) return found;
  const unsigned subleaves = a;
  const bool avx512 = found.has(CpuFeature::kAvx512);
  add(avx512 && bit(c, 11), CpuFeature::kAvx512Vnni);
  add(avx512 && bit(d, 23), CpuFeature::kAvx512Fp16);
  if (bit(d, 24) && tiles_permitted()) {
    add(true, CpuFeature::kAmxTile);
    add(bit(d, 22), CpuFeature::kAmxBf16);
    add(bit(d, 25), CpuFeature::kAmxInt8);
  }
  if (subleaves < 1 || __get_cpuid_count(7, 1, &a, &b, &c, &d) == 0) return found;
  add(bit(a, 4), CpuFeature::kAvxVnni);
  add(avx512 && bit(a, 5), CpuFeature::kAvx512Bf16);
  return found;
}

#elif defined(__aarch64__)

CpuFeatures detect() noexcept {
  CpuFeatures found = CpuFeatures().with(CpuFeature::kNeon);
#if defined(__linux__)
  const auto add = [&found](bool has, CpuFeature feature) {
    if (has) found = found.with(feature);
  };
  const unsigned long first = getauxval(AT_HWCAP), second = getauxval(AT_HWCAP2);
  add((first & HWCAP_ASIMDHP) != 0, CpuFeature::kFp16);
  add((first & HWCAP_ASIMDDP) != 0, CpuFeature::kDotProd);
  add((second & HWCAP2_I8MM) != 0, CpuFeature::kI8mm);
  add((second & HWCAP2_BF16) != 0, CpuFeature::kArmBf16);
#endif
  return found;
}

#else

CpuFeatures detect() noexcept { return {}; }

#endif

std::vector<Isa> isas_within(CpuFeatures features) {
  std::vector<Isa> all;
  for (int level = 0; level < kIsaLevels; ++level)
    if (features.includes(features_of(static_cast<Isa>(level)))) all.push_back(static_cast<Isa>(level));
  return all;
}

std::string list_of_available() {
  std::string out;
  for (const Isa isa : available_isas()) out += (out.empty() ? "" : ", ") + std::string(name_of(isa));
  return out;
}

void require_available(Isa isa, const std::string& origin) {
  if (!detected_features().includes(features_of(isa)))
    throw Error(ErrorKind::kUsage,
                origin + " asks for " + std::string(name_of(isa)) + ", which this CPU does not run",
                "available: " + list_of_available());
}

std::optional<CpuFeature> feature_from_name(std::string_view name) noexcept {
  const auto* const found = std::ranges::find(kFeatureNames, name);
  if (found == kFeatureNames.end()) return std::nullopt;
  return static_cast<CpuFeature>(found - kFeatureNames.begin());
}

}  // namespace

std::string_view name_of(CpuFeature feature) noexcept {
  return kFeatureNames[static_cast<std::size_t>(feature)];
}

std::string text_of(CpuFeatures features) {
  std::string out;
  for (int f = 0; f < kCpuFeatures; ++f)
    if (features.has(static_cast<CpuFeature>(f)))
      out += (out.empty() ? "" : " ") + std::string(name_of(static_cast<CpuFeature>(f)));
  return out.empty() ? "none" : out;
}

std::string_view name_of(Isa isa) noexcept { return kNames[static_cast<std::size_t>(isa)]; }

std::optional<Isa> isa_from_name(std::string_view name) noexcept {
  for (std::size_t i = 0; i < kNames.size(); ++i)
    if (kNames[i] == name) return static_cast<Isa>(i);
  return std::nullopt;
}

CpuFeatures features_of(Isa isa) noexcept {
  const CpuFeatures none, avx2 = none.with(CpuFeature::kAvx2), avx512 = avx2.with(CpuFeature::kAvx512);
  const CpuFeatures vnni = avx512.with(CpuFeature::kAvx512Vnni);
  const CpuFeatures bf16 = vnni.with(CpuFeature::kAvx512Bf16);
  const CpuFeatures neon = none.with(CpuFeature::kNeon), dot = neon.with(CpuFeature::kDotProd);
  const CpuFeatures i8mm = dot.with(CpuFeature::kI8mm);
  switch (isa) {
    case Isa::kBaseline:
      return none;
    case Isa::kAvx2:
      return avx2;
    case Isa::kAvxVnni:
      return avx2.with(CpuFeature::kAvxVnni);
    case Isa::kAvx512:
      return avx512;
    case Isa::kAvx512Vnni:
      return vnni;
    case Isa::kAvx512Bf16:
      return bf16;
    case Isa::kAmx:
      return bf16.with(CpuFeature::kAmxTile).with(CpuFeature::kAmxBf16).with(CpuFeature::kAmxInt8);
    case Isa::kNeon:
      return neon;
    case Isa::kNeonDot:
      return dot;
    case Isa::kNeonI8mm:
      return i8mm;
    case Isa::kNeonBf16:
      return i8mm.with(CpuFeature::kArmBf16);
  }
  return none;
}

bool runs_at(Isa kernel, Isa isa) noexcept { return features_of(isa).includes(features_of(kernel)); }

CpuFeatures detected_features() noexcept {
  static const CpuFeatures found = detect();
  return found;
}

Isa best_isa(CpuFeatures features) noexcept {
  for (int level = kIsaLevels - 1; level > 0; --level)
    if (features.includes(features_of(static_cast<Isa>(level)))) return static_cast<Isa>(level);
  return Isa::kBaseline;
}

Isa detected_isa() noexcept { return best_isa(detected_features()); }

std::vector<Isa> available_isas() { return isas_within(detected_features()); }

Isa isa_from_text(std::string_view text, const std::string& origin) {
  const std::string_view whole = text;
  const auto refuse = [&](std::string_view word) {
    throw Error(ErrorKind::kUsage,
                origin + " " + std::string(whole) + ": " + std::string(word) +
                    " is no instruction-set level or feature",
                "levels: " + list_of_available() +
                    "; features to switch off, \"-\" before each: " + text_of(detected_features()));
  };
  CpuFeatures features = detected_features();
  for (bool first = true; first || !text.empty(); first = false) {
    const std::size_t comma = text.find(',');
    const std::string_view word = text.substr(0, comma);
    text = comma == std::string_view::npos ? std::string_view() : text.substr(comma + 1);
    if (word.starts_with('-')) {
      const std::optional<CpuFeature> feature = feature_from_name(word.substr(1));
      if (!feature) refuse(word);
      features = features.without(*feature);
      continue;
    }
    const std::optional<Isa> isa = isa_from_name(word);
    if (!isa || !first) refuse(word);
    require_available(*isa, origin);
    features = features_of(*isa);
  }
  return best_isa(features);
}

Isa active_isa() {
  if (forced >= 0) return static_cast<Isa>(forced.load());
  const char* wanted = std::getenv("SLIDE_ISA");
  if (wanted == nullptr || *wanted == '\0') return detected_isa();
  return isa_from_text(wanted, "SLIDE_ISA");
}

void set_isa(Isa isa) {
  require_available(isa, "the caller");
  forced = static_cast<int>(isa);
}

}  // namespace slide
