#include "runtime/threads.h"

#include <doctest/doctest.h>

#include <limits>
#include <numeric>
#include <vector>

#include "runtime/error.h"

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
