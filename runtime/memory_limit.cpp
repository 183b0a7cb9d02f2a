#include "runtime/memory_limit.h"

#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <limits>

namespace slide {
namespace {

constexpr std::size_t kNone = std::numeric_limits<std::size_t>::max();

std::size_t machine() noexcept {
  const long pages = ::sysconf(_SC_PHYS_PAGES);
  const long page = ::sysconf(_SC_PAGESIZE);
  return pages > 0 && page > 0 ? static_cast<std::size_t>(pages) * static_cast<std::size_t>(page) : kNone;
}

/// A container sees its own group at this place. The file says "max" where there is no limit.
std::size_t control_group() noexcept {
  std::FILE* file = std::fopen("/sys/fs/cgroup/memory.max", "re");
  if (file == nullptr) return kNone;
  unsigned long long bytes = 0;
  const bool limited = std::fscanf(file, "%llu", &bytes) == 1;
  std::fclose(file);
  return limited ? static_cast<std::size_t>(bytes) : kNone;
}

std::size_t address_space() noexcept {
  rlimit limit{};
  if (::getrlimit(RLIMIT_AS, &limit) != 0 || limit.rlim_cur == RLIM_INFINITY) return kNone;
  return static_cast<std::size_t>(limit.rlim_cur);
}

}  // namespace

std::size_t memory_of_process() noexcept { return std::min({machine(), control_group(), address_space()}); }

}  // namespace slide
