#pragma once

#include <atomic>
#include <cstdint>
#include <functional>

namespace slide {

/// The number of threads parallel loops use: the one set, else OMP_NUM_THREADS, else the number of cores.
[[nodiscard]] int thread_count() noexcept;
/// Sets it; values below 1 mean the default again.
void set_thread_count(int count) noexcept;

/// Calls body(i) once for every i in [0, n), in parallel, in consecutive WorkRanges. Which thread runs which
/// i is not defined, so body must write only what belongs to i; then the result is the same at any thread
/// count. The first exception thrown by a body is rethrown here, after all running bodies have ended. Nested
/// calls run on the calling thread. Denormals are flushed to zero only if the caller's mode says so: the
/// workers take over the caller's floating-point mode.
void parallel_for(std::int64_t n, const std::function<void(std::int64_t)>& body);

/// Hands out [0, n) in consecutive ranges to threads that ask for work: 32 or more for each of `takers`, of
/// one element if there are few. A counter that two cores increase costs a tenth of a microsecond, as much as
/// a small task.
class WorkRanges {
 public:
  struct Range {
    std::int64_t first, last;
  };
  WorkRanges(std::int64_t n, std::int64_t takers) noexcept;
  /// The next one; empty at the end.
  [[nodiscard]] Range take() noexcept;

 private:
  std::int64_t n_, size_;
  std::atomic<std::int64_t> next_{0};
};

/// The index of the calling thread within the running parallel_for, in [0, thread_count()); 0 outside of one.
/// For scratch memory only: results must not depend on it.
[[nodiscard]] int thread_index() noexcept;

/// While it lives, denormal numbers are flushed to zero (inputs and results) on this thread and, through
/// parallel_for, on the workers. The mode before is restored at the end.
class FlushDenormals {
 public:
  FlushDenormals() noexcept;
  ~FlushDenormals();
  FlushDenormals(const FlushDenormals&) = delete;
  FlushDenormals& operator=(const FlushDenormals&) = delete;

 private:
  std::uint64_t saved_;
};

}  // namespace slide
