#pragma once

#include <cstdlib>

namespace slide::test {

/// Whether slow tests are to be left out, as under sanitizers and emulators.
inline bool quick() { return std::getenv("SLIDE_TEST_QUICK") != nullptr; }

}  // namespace slide::test
