// What this machine can do at most: multiply-adds in float32, bfloat16 and 8 bits a second, and bytes from
// memory, at each instruction-set level, with one thread and with all. The best of many short turns counts,
// so that other programs disturb little.
//   peak_benchmark [--json]
// Or only how many nanoseconds a cache line takes from one core to another and back: cores that share a cache
// need a fraction of what others do, and a virtual machine's move between the two.
//   peak_benchmark --round-trip

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <functional>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "benchmarks/peak_routines.h"
#include "runtime/cpu.h"
#include "runtime/threads.h"

namespace {

using namespace slide;

constexpr int kTurns = 40;
constexpr std::int64_t kFloats = 32 << 20;  // 128 MiB, more than any cache

const peak::Routines* routines_of(Isa isa) {
  switch (isa) {
#ifdef SLIDE_HAVE_BASELINE
    case Isa::kBaseline:
      return &peak::baseline::kRoutines;
#endif
#ifdef SLIDE_HAVE_AVX2
    case Isa::kAvx2:
      return &peak::avx2::kRoutines;
#endif
#ifdef SLIDE_HAVE_AVX512
    case Isa::kAvx512:
      return &peak::avx512::kRoutines;
#endif
#ifdef SLIDE_HAVE_AVX512BF16
    case Isa::kAvx512Bf16:
      return &peak::avx512bf16::kRoutines;
#endif
#ifdef SLIDE_HAVE_NEON
    case Isa::kNeon:
      return &peak::neon::kRoutines;
#endif
    default:
      return nullptr;
  }
}

/// The shortest of several turns, in seconds; every thread calls body with its number.
double best_seconds(int threads, const std::function<void(std::int64_t)>& body) {
  double best = 1e30;
  for (int turn = 0; turn < kTurns; ++turn) {
    const auto start = std::chrono::steady_clock::now();
    parallel_for(threads, body);
    best = std::min(best, std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
  }
  return best;
}

/// Billions of operations a second of one of the arithmetic loops; 0 if there is none.
double arithmetic(void (*loop)(std::int64_t), double operations, int threads) {
  if (loop == nullptr) return 0;
  constexpr std::int64_t kCount = 2'000'000;
  const double seconds = best_seconds(threads, [&](std::int64_t) { loop(kCount); });
  return 1e-9 * operations * static_cast<double>(kCount) * threads / seconds;
}

struct Peaks {
  Isa isa;
  int threads;
  double fp32, bf16, int8;  ///< 10⁹ operations a second, a multiply-add being two
  double read, copy;        ///< 10⁹ bytes a second; a copied byte counts twice
};

Peaks measure(Isa isa, int threads, std::vector<float>& x, std::vector<float>& y) {
  const peak::Routines& r = *routines_of(isa);
  set_thread_count(threads);
  const std::int64_t part = kFloats / threads / 256 * 256;
  std::vector<float> sums(static_cast<std::size_t>(threads));
  const double reading = best_seconds(threads, [&](std::int64_t i) {
    sums[static_cast<std::size_t>(i)] = r.read(x.data() + i * part, part);
  });
  const double copying =
      best_seconds(threads, [&](std::int64_t i) { r.copy(x.data() + i * part, y.data() + i * part, part); });
  const double bytes = 4e-9 * static_cast<double>(part) * threads;
  return {.isa = isa,
          .threads = threads,
          .fp32 = arithmetic(r.fp32, r.fp32_operations, threads),
          .bf16 = arithmetic(r.bf16, r.bf16_operations, threads),
          .int8 = arithmetic(r.int8, r.int8_operations, threads),
          .read = bytes / reading,
          .copy = 2 * bytes / copying};
}

/// The shortest of several turns, in nanoseconds.
double round_trip() {
  constexpr int kCount = 2000, kTimed = 1000;
  alignas(128) std::atomic<int> ball{0};
  double best = 1e30;
  for (int turn = 0; turn < kTurns / 4; ++turn) {
    ball = 0;
    std::thread other([&] {
      for (int i = 0; i < kCount; ++i) {
        while (ball.load() != 2 * i + 1) continue;
        ball.store(2 * i + 2);
      }
    });
    std::chrono::steady_clock::time_point start;
    for (int i = 0; i < kCount; ++i) {
      if (i == kCount - kTimed) start = std::chrono::steady_clock::now();  // by then the other one runs
      ball.store(2 * i + 1);
      while (ball.load() != 2 * i + 2) continue;
    }
    const std::chrono::duration<double, std::nano> time = std::chrono::steady_clock::now() - start;
    best = std::min(best, time.count() / kTimed);
    other.join();
  }
  return best;
}

void print_table(const std::vector<Peaks>& all) {
  std::printf("%-11s %7s %10s %10s %10s %10s %10s\n", "level", "threads", "fp32", "bf16", "int8", "read",
              "copy");
  std::printf("%-11s %7s %10s %10s %10s %10s %10s\n", "", "", "GFLOP/s", "GFLOP/s", "GOP/s", "GB/s", "GB/s");
  for (const Peaks& p : all)
    std::printf("%-11s %7d %10.1f %10.1f %10.1f %10.1f %10.1f\n", std::string(name_of(p.isa)).c_str(),
                p.threads, p.fp32, p.bf16, p.int8, p.read, p.copy);
}

void print_json(const std::vector<Peaks>& all) {
  std::printf("[");
  for (std::size_t i = 0; i < all.size(); ++i) {
    const Peaks& p = all[i];
    std::printf(
        "%s\n {\"isa\": \"%s\", \"threads\": %d, \"fp32\": %.2f, \"bf16\": %.2f, \"int8\": %.2f, "
        "\"read\": %.2f, \"copy\": %.2f}",
        i == 0 ? "" : ",", std::string(name_of(p.isa)).c_str(), p.threads, p.fp32, p.bf16, p.int8, p.read,
        p.copy);
  }
  std::printf("\n]\n");
}

}  // namespace

int main(int argc, char** argv) {
  const bool json = argc == 2 && std::strcmp(argv[1], "--json") == 0;
  const bool trip = argc == 2 && std::strcmp(argv[1], "--round-trip") == 0;
  if (argc > 1 && !json && !trip) {
    std::fprintf(stderr, "peak_benchmark [--json | --round-trip]\n");
    return 2;
  }
  if (trip) {
    if (std::thread::hardware_concurrency() < 2) {
      std::fprintf(stderr, "peak_benchmark: a round trip takes two cores\n");
      return 1;
    }
    std::printf("%.0f\n", round_trip());
    return 0;
  }
  const int cores = thread_count();
  std::vector<float> x(static_cast<std::size_t>(kFloats), 1);
  std::vector<float> y(x.size());
  std::vector<Peaks> all;
  for (const Isa isa : available_isas())
    if (routines_of(isa) != nullptr)
      for (const int threads : std::set<int>{1, cores}) all.push_back(measure(isa, threads, x, y));
  json ? print_json(all) : print_table(all);
  return 0;
}
