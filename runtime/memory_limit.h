#pragma once

#include <cstddef>

namespace slide {

/// The most memory that this process can have, bytes: the machine's, or less where its control group (cgroup
/// v2 memory.max) or its address space (RLIMIT_AS) is limited to less. What other programs hold is not
/// subtracted.
[[nodiscard]] std::size_t memory_of_process() noexcept;

}  // namespace slide
