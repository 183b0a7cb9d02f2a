#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <functional>

namespace slide {

/// The number of threads parallel loops use: the one set, else OMP_NUM_THREADS, else the number of cores.
[[nodiscard]] int thread_count() noexcept;
/// Sets it; values below 1 mean the default again.
void set_thread_count(int count) noexcept;

/// Calls body(i) once for every i in [0, n), in parallel, in WorkRanges. Which thread runs which
/// i is not defined, so body must write only what belongs to i; then the result is the same at any thread
/// count. The first exception thrown by a body is rethrown here, after all running bodies have ended. Nested
/// calls run on the calling thread. Denormals are flushed to zero only if the caller's mode says so: the
/// workers take over the caller's floating-point mode.
void parallel_for(std::int64_t n, const std::function<void(std::int64_t)>& body);

/// The same with body(i, slot), on at most `slots` threads: slot, in [0, slots), tells which memory of its
/// own a thread may use meanwhile.
void parallel_for(std::int64_t n, std::int64_t slots,
                  const std::function<void(std::int64_t, std::int64_t)>& body);

/// Hands out [0, n) to threads that ask for work. Each has a part, consecutive elements, which it takes in
/// order, and then helps the others with theirs. So what a thread does mostly lies together, at the same
/// place in each layer of a network, in its own caches, and no counter travels between cores until the end:
/// where they do not share a cache, that takes as long as a small task.
class WorkRanges {
 public:
  struct Range {
    std::int64_t first, last;
  };
  WorkRanges(std::int64_t n, std::int64_t takers) noexcept;
  /// The next one for thread `taker` >= 0; empty at the end.
  [[nodiscard]] Range take(std::int64_t taker) noexcept;

 private:
  static constexpr std::int64_t kMostParts = 64;  // shared by more takers
  struct alignas(64) Part {                       // a cache line each
    std::atomic<std::int64_t> next;
    std::int64_t end;
  };
  std::int64_t parts_, size_;
  std::array<Part, kMostParts> part_;
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
