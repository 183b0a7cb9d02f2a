#include "runtime/threads.h"

#include <omp.h>

#include <algorithm>
#include <exception>
#include <future>
#include <mutex>
#include <thread>
#include <vector>
#if defined(__x86_64__)
#include <xmmintrin.h>
#endif

#include "runtime/error.h"
#include "runtime/thread_scope.h"

namespace slide {
namespace {

constexpr std::int64_t kRangesPerPart = 32;  // so that at most such a share of a part is waited for

std::atomic<int> wanted_threads{0};
thread_local int scoped_threads = 0;  // NOLINT(cppcoreguidelines-avoid-non-const-global-variables)

/// The floating-point control word: MXCSR on x86-64, FPCR on AArch64.
std::uint64_t float_mode() noexcept {
#if defined(__x86_64__)
  return _mm_getcsr();
#elif defined(__aarch64__)
  std::uint64_t mode;
  __asm__ volatile("mrs %0, fpcr" : "=r"(mode));
  return mode;
#else
  return 0;
#endif
}

void set_float_mode(std::uint64_t mode) noexcept {
#if defined(__x86_64__)
  _mm_setcsr(static_cast<unsigned>(mode));
#elif defined(__aarch64__)
  __asm__ volatile("msr fpcr, %0" : : "r"(mode));
#else
  (void)mode;
#endif
}

constexpr std::uint64_t kFlushBits =
#if defined(__x86_64__)
    0x8040;  // FTZ and DAZ
#elif defined(__aarch64__)
    std::uint64_t{1} << 24;  // FZ
#else
    0;
#endif

}  // namespace

int thread_count() noexcept {
  const int wanted = scoped_threads > 0 ? scoped_threads : wanted_threads.load();
  return wanted > 0 ? wanted : omp_get_max_threads();
}

void set_thread_count(int count) noexcept { wanted_threads = count; }

ThreadScope::ThreadScope(int count) noexcept : before_(scoped_threads) {
  if (count > 0) scoped_threads = count;
}

ThreadScope::~ThreadScope() { scoped_threads = before_; }

WorkRanges::WorkRanges(std::int64_t n, std::int64_t takers) noexcept
    : parts_(std::clamp<std::int64_t>(n, 1, std::min(std::max<std::int64_t>(takers, 1), kMostParts))),
      size_(std::max<std::int64_t>(1, n / (parts_ * kRangesPerPart))) {
  for (std::int64_t i = 0; i < parts_; ++i) {
    Part& part = part_[static_cast<std::size_t>(i)];
    part.next.store(n * i / parts_, std::memory_order_relaxed);
    part.end = n * (i + 1) / parts_;
  }
}

WorkRanges::Range WorkRanges::take(std::int64_t taker) noexcept {
  for (std::int64_t i = 0; i < parts_; ++i) {
    Part& part = part_[static_cast<std::size_t>((taker + i) % parts_)];
    if (part.next.load(std::memory_order_relaxed) >= part.end) continue;
    const std::int64_t first = part.next.fetch_add(size_, std::memory_order_relaxed);
    if (first < part.end) return {first, std::min(first + size_, part.end)};
  }
  return {};
}

namespace {

/// Makes sure, once for each larger number, that so many threads can be started: OpenMP's runtime ends the
/// process, leaving its files behind, where one cannot.
void require_threads(int count) {
  static std::atomic<int> proven{1};
  if (count <= proven.load()) return;
  std::vector<std::thread> threads;
  std::promise<void> over;
  const std::shared_future<void> end = over.get_future().share();
  std::exception_ptr failure;
  try {
    threads.reserve(static_cast<std::size_t>(count));
    for (int i = 1; i < count; ++i) threads.emplace_back([end] { end.wait(); });
  } catch (...) {
    failure = std::current_exception();
  }
  over.set_value();
  for (std::thread& thread : threads) thread.join();
  if (failure)
    throw Error(ErrorKind::kOutOfMemory, std::to_string(count) + " threads cannot be started",
                "fewer --threads need less");
  proven = count;
}

}  // namespace

int thread_index() noexcept { return omp_get_thread_num(); }

void parallel_for(std::int64_t n, const std::function<void(std::int64_t)>& body) {
  if (n <= 0) return;
  if (n == 1 || thread_count() == 1 || omp_in_parallel() != 0) {
    for (std::int64_t i = 0; i < n; ++i) body(i);
    return;
  }
  const int threads = thread_count();
  require_threads(threads);
  WorkRanges ranges(n, threads);
  std::exception_ptr failure;
  std::mutex failure_mutex;
  std::atomic<bool> failed{false};
  const std::uint64_t mode = float_mode();
#pragma omp parallel num_threads(threads)
  {
    const std::uint64_t worker_mode = float_mode();
    set_float_mode(mode);
    try {
      const int self = omp_get_thread_num();
      for (WorkRanges::Range r = ranges.take(self); r.first < r.last && !failed; r = ranges.take(self))
        for (std::int64_t i = r.first; i < r.last; ++i) body(i);
    } catch (...) {
      const std::scoped_lock lock(failure_mutex);
      if (!failure) failure = std::current_exception();
      failed = true;
    }
    set_float_mode(worker_mode);
  }
  if (failure) std::rethrow_exception(failure);
}

void parallel_for(std::int64_t n, std::int64_t slots,
                  const std::function<void(std::int64_t, std::int64_t)>& body) {
  WorkRanges ranges(n, slots);
  parallel_for(std::min(n, slots), [&](std::int64_t slot) {
    for (WorkRanges::Range r = ranges.take(slot); r.first < r.last; r = ranges.take(slot))
      for (std::int64_t i = r.first; i < r.last; ++i) body(i, slot);
  });
}

FlushDenormals::FlushDenormals() noexcept : saved_(float_mode()) { set_float_mode(saved_ | kFlushBits); }

FlushDenormals::~FlushDenormals() { set_float_mode(saved_); }

}  // namespace slide
