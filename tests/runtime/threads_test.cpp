#include "runtime/threads.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <atomic>
#include <limits>
#include <numeric>
#include <thread>
#include <vector>

#include "runtime/error.h"
#include "runtime/thread_scope.h"

using namespace slide;

TEST_CASE("parallel_for visits every index once at any thread count") {
  for (const int threads : {1, 2, 3, 8}) {
    set_thread_count(threads);
    std::vector<int> visits(1000, 0);
    parallel_for(1000, [&](std::int64_t i) { ++visits[static_cast<std::size_t>(i)]; });
    CHECK(std::accumulate(visits.begin(), visits.end(), 0) == 1000);
    CHECK(*std::min_element(visits.begin(), visits.end()) == 1);
  }
  set_thread_count(0);
}

TEST_CASE(
    "parallel_for with slots visits every index once, and no two threads have the same slot at a time") {
  for (const int threads : {1, 2, 3, 8}) {
    set_thread_count(threads);
    for (const std::int64_t slots : {1, 2, 5, 100}) {
      std::vector<int> visits(300, 0);
      std::vector<std::atomic<int>> users(static_cast<std::size_t>(slots));
      std::atomic<bool> alone{true};
      parallel_for(300, slots, [&](std::int64_t i, std::int64_t slot) {
        REQUIRE(slot >= 0);
        REQUIRE(slot < slots);
        if (++users[static_cast<std::size_t>(slot)] != 1) alone = false;
        ++visits[static_cast<std::size_t>(i)];
        --users[static_cast<std::size_t>(slot)];
      });
      CHECK(alone);
      CHECK(std::accumulate(visits.begin(), visits.end(), 0) == 300);
      CHECK(*std::min_element(visits.begin(), visits.end()) == 1);
    }
  }
  set_thread_count(0);
}

TEST_CASE("a taker of work has a part of its own, in order, and then helps the others") {
  WorkRanges ranges(200, 2);
  std::int64_t at = 100;
  for (; at < 200; ++at) {  // the second half, and then the first
    const WorkRanges::Range range = ranges.take(1);
    REQUIRE(range.first == at);
    at = range.last - 1;
  }
  CHECK(ranges.take(0).first == 0);
  CHECK(ranges.take(1).first > 0);
  for (WorkRanges::Range range = ranges.take(1); range.first < range.last; range = ranges.take(1))
    at = range.last;
  CHECK(at == 100);
  const WorkRanges::Range none = ranges.take(0);
  CHECK(none.first == none.last);
}

TEST_CASE("work is handed out once, be there more takers than elements or parts, or none of either") {
  for (const std::int64_t n : {0, 1, 7, 64, 1000})
    for (const std::int64_t takers : {0, 1, 3, 65, 500}) {
      CAPTURE(n);
      CAPTURE(takers);
      WorkRanges ranges(n, takers);
      std::int64_t taken = 0, idle = 0;
      for (std::int64_t taker = takers; idle <= takers; taker = taker == 0 ? takers : taker - 1) {
        const WorkRanges::Range range = ranges.take(taker);
        taken += range.last - range.first;
        idle = range.first < range.last ? 0 : idle + 1;
      }
      CHECK(taken == n);
    }
}

TEST_CASE("an exception in a worker reaches the caller") {
  set_thread_count(4);
  CHECK_THROWS_AS(parallel_for(100,
                               [](std::int64_t i) {
                                 if (i == 57) throw Error(ErrorKind::kBadInput, "row 57");
                               }),
                  Error);
  set_thread_count(0);
}

TEST_CASE("denormals are flushed on all workers while asked for, and never after") {
  set_thread_count(4);
  volatile float tiny = std::numeric_limits<float>::min();
  std::vector<float> halves(64, -1.0F);
  const auto halve = [&](std::int64_t i) { halves[static_cast<std::size_t>(i)] = tiny / 2; };
  {
    const FlushDenormals flush;
    parallel_for(64, halve);
    for (const float h : halves) CHECK(h == 0.0F);
  }
  parallel_for(64, halve);
  for (const float h : halves) CHECK(h > 0.0F);
  set_thread_count(0);
}

TEST_CASE("a scope's number of threads holds on its own thread, until it ends") {
  set_thread_count(3);
  {
    const ThreadScope two(2);
    CHECK(thread_count() == 2);
    {
      const ThreadScope one(1);
      CHECK(thread_count() == 1);
      const ThreadScope as_before(0);
      CHECK(thread_count() == 1);
    }
    CHECK(thread_count() == 2);
    int elsewhere = 0;
    std::thread([&] { elsewhere = thread_count(); }).join();
    CHECK(elsewhere == 3);
    std::vector<int> used(64, -1);
    parallel_for(64, [&](std::int64_t i) { used[static_cast<std::size_t>(i)] = thread_index(); });
    for (const int thread : used) CHECK((thread == 0 || thread == 1));
  }
  CHECK(thread_count() == 3);
  set_thread_count(0);
}
