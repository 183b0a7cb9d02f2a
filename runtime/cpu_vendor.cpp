#include "runtime/cpu_vendor.h"

#include <array>
#include <cstring>

#if defined(__x86_64__)
#include <cpuid.h>
#endif

namespace slide {
namespace {

std::array<char, 12> read_vendor() noexcept {
  std::array<char, 12> text{};
#if defined(__x86_64__)
  unsigned a = 0, words[3] = {};
  __get_cpuid(0, &a, &words[0], &words[2], &words[1]);  // the text lies in EBX, EDX, ECX
  std::memcpy(text.data(), words, text.size());
#endif
  return text;
}

}  // namespace

std::string_view cpu_vendor() noexcept {
  static const std::array<char, 12> vendor = read_vendor();
  return vendor[0] == '\0' ? std::string_view() : std::string_view(vendor.data(), vendor.size());
}

}  // namespace slide
