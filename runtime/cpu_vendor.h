#pragma once

#include <string_view>

namespace slide {

/// Who made this CPU, as CPUID leaf 0 says: "GenuineIntel", "AuthenticAMD"; empty where there is no CPUID.
[[nodiscard]] std::string_view cpu_vendor() noexcept;

}  // namespace slide
