// The same targets under libFuzzer, chosen by the environment's SLIDE_FUZZ_TARGET.

#include <cstdio>
#include <cstdlib>
#include <string>
#include <utility>

#include "tests/fuzz/targets.h"

namespace {

slide::fuzz::Target chosen() {
  const char* name = std::getenv("SLIDE_FUZZ_TARGET");
  for (slide::fuzz::Target& target : slide::fuzz::targets())
    if (name != nullptr && target.name == name) return std::move(target);
  std::fputs("set SLIDE_FUZZ_TARGET to one of:", stderr);
  for (const slide::fuzz::Target& target : slide::fuzz::targets())
    std::fprintf(stderr, " %s", target.name.c_str());
  std::fputs("\n", stderr);
  std::exit(2);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const slide::fuzz::Target target = chosen();
  (void)target.read({data, size});
  return 0;
}
