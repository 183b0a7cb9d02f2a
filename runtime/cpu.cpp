#include "runtime/cpu.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cstdlib>

#include "runtime/error.h"

namespace slide {
namespace {

constexpr std::array<std::string_view, 5> kNames = {"baseline", "avx2", "avx512", "avx512bf16", "neon"};

std::atomic<int> forced{-1};

std::string list_of_available() {
  std::string out;
  for (const Isa isa : available_isas()) out += (out.empty() ? "" : ", ") + std::string(name_of(isa));
  return out;
}

void require_available(Isa isa, const std::string& origin) {
  const std::vector<Isa> all = available_isas();
  if (std::find(all.begin(), all.end(), isa) == all.end())
    throw Error(ErrorKind::kUsage,
                origin + " asks for " + std::string(name_of(isa)) + ", which this CPU does not run",
                "available: " + list_of_available());
}

}  // namespace

std::string_view name_of(Isa isa) noexcept { return kNames[static_cast<std::size_t>(isa)]; }

std::optional<Isa> isa_from_name(std::string_view name) noexcept {
  for (std::size_t i = 0; i < kNames.size(); ++i)
    if (kNames[i] == name) return static_cast<Isa>(i);
  return std::nullopt;
}

Isa detected_isa() noexcept {
#if defined(__aarch64__)
  return Isa::kNeon;
#elif defined(__x86_64__)
  if (!__builtin_cpu_supports("avx2") || !__builtin_cpu_supports("fma")) return Isa::kBaseline;
  if (!__builtin_cpu_supports("avx512f") || !__builtin_cpu_supports("avx512bw") ||
      !__builtin_cpu_supports("avx512dq") || !__builtin_cpu_supports("avx512vl"))
    return Isa::kAvx2;
  if (!__builtin_cpu_supports("avx512bf16") || !__builtin_cpu_supports("avx512vnni")) return Isa::kAvx512;
  return Isa::kAvx512Bf16;
#else
  return Isa::kBaseline;
#endif
}

std::vector<Isa> available_isas() {
  if (detected_isa() == Isa::kNeon) return {Isa::kBaseline, Isa::kNeon};
  std::vector<Isa> all;
  for (int level = 0; level <= static_cast<int>(detected_isa()); ++level)
    all.push_back(static_cast<Isa>(level));
  return all;
}

Isa active_isa() {
  if (forced >= 0) return static_cast<Isa>(forced.load());
  const char* wanted = std::getenv("SLIDE_ISA");
  if (wanted == nullptr || *wanted == '\0') return detected_isa();
  const std::optional<Isa> isa = isa_from_name(wanted);
  if (!isa)
    throw Error(ErrorKind::kUsage, "SLIDE_ISA=" + std::string(wanted) + " is no instruction-set level",
                "available: " + list_of_available());
  require_available(*isa, "SLIDE_ISA");
  return *isa;
}

void set_isa(Isa isa) {
  require_available(isa, "the caller");
  forced = static_cast<int>(isa);
}

}  // namespace slide
