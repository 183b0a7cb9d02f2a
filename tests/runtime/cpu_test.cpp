#include "runtime/cpu.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <fstream>
#include <sstream>
#include <string>

#include "runtime/error.h"

using namespace slide;

namespace {

/// The words behind "flags" or "Features" that the operating system lists for the first CPU, between spaces;
/// empty where it does not.
std::string flags_of_system() {
  std::ifstream file("/proc/cpuinfo");
  for (std::string line; std::getline(file, line);)
    if (line.starts_with("flags") || line.starts_with("Features")) return line + " ";
  return "";
}

}  // namespace

TEST_CASE("features are those that the operating system lists") {
  const std::string flags = flags_of_system();
  const CpuFeatures found = detected_features();
#if defined(__x86_64__)
  const auto listed = [&](const char* name) {
    return flags.find(" " + std::string(name) + " ") != std::string::npos;
  };
  REQUIRE(!flags.empty());
  CHECK(found.has(CpuFeature::kAvx2) == (listed("avx2") && listed("fma")));
  CHECK(found.has(CpuFeature::kF16c) == listed("f16c"));
  CHECK(found.has(CpuFeature::kAvxVnni) == listed("avx_vnni"));
  CHECK(found.has(CpuFeature::kAvx512) ==
        (listed("avx512f") && listed("avx512bw") && listed("avx512dq") && listed("avx512vl")));
  CHECK(found.has(CpuFeature::kAvx512Vnni) == listed("avx512_vnni"));
  CHECK(found.has(CpuFeature::kAvx512Bf16) == listed("avx512_bf16"));
  CHECK(found.has(CpuFeature::kAvx512Fp16) == listed("avx512_fp16"));
  // The permission may be missing where the instructions are not.
  CHECK(found.has(CpuFeature::kAmxBf16) == (listed("amx_bf16") && found.has(CpuFeature::kAmxTile)));
  CHECK(found.has(CpuFeature::kAmxInt8) == (listed("amx_int8") && found.has(CpuFeature::kAmxTile)));
  CHECK((!found.has(CpuFeature::kAmxTile) || listed("amx_tile")));
#elif defined(__aarch64__)
  CHECK(found.has(CpuFeature::kNeon));
#endif
}

TEST_CASE("levels run where their features are") {
  CHECK(runs_at(Isa::kAvx512Vnni, Isa::kAvx512Bf16));
  CHECK(runs_at(Isa::kAvx2, Isa::kAvxVnni));
  CHECK(runs_at(Isa::kAvx512Bf16, Isa::kAmx));
  CHECK(best_isa(features_of(Isa::kAmx).without(CpuFeature::kAmxTile)) == Isa::kAvx512Bf16);
  CHECK(best_isa(features_of(Isa::kAmx).without(CpuFeature::kAvx512Bf16)) == Isa::kAvx512Vnni);
  CHECK_FALSE(runs_at(Isa::kAvxVnni, Isa::kAvx512));  // a level of its own, not one below
  CHECK_FALSE(runs_at(Isa::kAvx512, Isa::kAvxVnni));
  CHECK_FALSE(runs_at(Isa::kBaseline, Isa::kNeon) == runs_at(Isa::kAvx2, Isa::kNeon));
  CHECK(best_isa(features_of(Isa::kAvx512Bf16).without(CpuFeature::kAvx512Vnni)) == Isa::kAvx512);
  CHECK(best_isa(features_of(Isa::kAvx512Bf16).without(CpuFeature::kAvx512Bf16)) == Isa::kAvx512Vnni);
  CHECK(best_isa(features_of(Isa::kAvx512Bf16).without(CpuFeature::kAvx512).with(CpuFeature::kAvxVnni)) ==
        Isa::kAvxVnni);
  CHECK(runs_at(Isa::kNeonDot, Isa::kNeonI8mm));
  CHECK(runs_at(Isa::kNeonI8mm, Isa::kNeonBf16));
  CHECK(best_isa(features_of(Isa::kNeonBf16).without(CpuFeature::kArmBf16)) == Isa::kNeonI8mm);
  CHECK(best_isa(features_of(Isa::kNeonBf16).without(CpuFeature::kI8mm)) == Isa::kNeonDot);
  CHECK(best_isa(features_of(Isa::kNeonBf16).without(CpuFeature::kDotProd)) == Isa::kNeon);
  CHECK(best_isa({}) == Isa::kBaseline);
}

TEST_CASE("a level is named, features are switched off") {
  CHECK(isa_from_text("baseline", "--isa") == Isa::kBaseline);
  for (const Isa isa : available_isas()) CHECK(isa_from_text(name_of(isa), "--isa") == isa);
  CpuFeatures rest = detected_features();
  for (const CpuFeature f : {CpuFeature::kAmxTile, CpuFeature::kAvx512Vnni}) rest = rest.without(f);
  CHECK(isa_from_text("-amx_tile,-avx512_vnni", "--isa") == best_isa(rest));
  CHECK(isa_from_text("baseline,-avx2", "--isa") == Isa::kBaseline);
  for (const char* wrong : {"mmx", "", "-mmx", "baseline,avx2", "baseline,,-avx2", "avx2 ", "-"}) {
    INFO(wrong);
    CHECK_THROWS_AS((void)isa_from_text(wrong, "--isa"), Error);
  }
}
