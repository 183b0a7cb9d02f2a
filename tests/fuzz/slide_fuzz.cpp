// slide_fuzz [TARGET|all] [SECONDS] [SEED]: feeds the readers with damaged inputs. A crash, a sanitizer's
// report or an exception that is no Error ends it; the input that did it is left in slide_fuzz.input.

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <random>
#include <string>

#include "tests/fuzz/targets.h"

using slide::fuzz::Bytes;
using slide::fuzz::Target;

namespace {

/// Damages inputs, the same way for the same seed.
class Mutator {
 public:
  Mutator(const std::vector<Bytes>& seeds, std::uint32_t seed) : seeds_(seeds), random_(seed) {}

  Bytes next() {
    Bytes bytes = seeds_[below(seeds_.size())];
    for (std::size_t n = 1 + below(4); n > 0; --n) damage(bytes);
    return bytes;
  }

 private:
  std::size_t below(std::size_t n) { return std::uniform_int_distribution<std::size_t>(0, n - 1)(random_); }

  void damage(Bytes& bytes) {
    if (bytes.empty()) return bytes.push_back(static_cast<std::uint8_t>(below(256)));
    const std::size_t at = below(bytes.size());
    constexpr std::uint8_t kEdges[] = {0x00, 0x01, 0x7F, 0x80, 0xFE, 0xFF, 0x20, 0x30};
    const auto place = [&](std::size_t i) { return bytes.begin() + static_cast<std::ptrdiff_t>(i); };
    switch (below(7)) {
      case 0:  // a bit
        bytes[at] = static_cast<std::uint8_t>(bytes[at] ^ 1U << below(8));
        return;
      case 1:  // a byte
        bytes[at] = static_cast<std::uint8_t>(below(256));
        return;
      case 2:  // up to eight bytes: the ends of numbers' ranges
        for (std::size_t i = at, n = 1 + below(8); n > 0 && i < bytes.size(); ++i, --n)
          bytes[i] = kEdges[below(std::size(kEdges))];
        return;
      case 3:  // cut short
        bytes.resize(at);
        return;
      case 4: {  // a part is missing
        const std::size_t end = std::min(bytes.size(), at + 1 + below(64));
        bytes.erase(place(at), place(end));
        return;
      }
      case 5: {  // a part comes twice
        const Bytes part(place(at), place(std::min(bytes.size(), at + 1 + below(64))));
        bytes.insert(place(at), part.begin(), part.end());
        return;
      }
      default: {  // a part of another input
        const Bytes& other = seeds_[below(seeds_.size())];
        const std::size_t from = below(other.size());
        for (std::size_t i = 0, n = 1 + below(64); i < n && at + i < bytes.size() && from + i < other.size();
             ++i)
          bytes[at + i] = other[from + i];
      }
    }
  }

  const std::vector<Bytes>& seeds_;
  std::mt19937 random_;
};

void keep(const Bytes& bytes) {
  std::ofstream("slide_fuzz.input", std::ios::binary)
      .write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
}

/// Also what a signal leaves behind: the input is written before it is read.
bool run(const Target& target, double seconds, std::uint32_t seed) {
  for (const Bytes& good : target.seeds)
    if (!target.read(good)) {
      std::printf("%s: a seed of %zu bytes is not taken\n", target.name.c_str(), good.size());
      return false;
    }
  Mutator mutator(target.seeds, seed);
  long inputs = 0;
  long taken = 0;
  const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(seconds);
  while (std::chrono::steady_clock::now() < end) {
    const Bytes bytes = mutator.next();
    keep(bytes);
    taken += target.read(bytes) ? 1 : 0;
    ++inputs;
  }
  std::printf("%-12s %8ld inputs, %7ld of them taken\n", target.name.c_str(), inputs, taken);
  std::fflush(stdout);
  return inputs > 0;
}

}  // namespace

int main(int argc, char** argv) {
  const std::string name = argc > 1 ? argv[1] : "all";
  const double seconds = argc > 2 ? std::atof(argv[2]) : 1;
  const auto seed = static_cast<std::uint32_t>(argc > 3 ? std::atol(argv[3]) : 1);
  int found = 0;
  for (const Target& target : slide::fuzz::targets()) {
    if (name != "all" && name != target.name) continue;
    ++found;
    if (!run(target, seconds, seed)) return 1;
  }
  if (found == 0) std::fprintf(stderr, "slide_fuzz: there is no target %s\n", name.c_str());
  return found > 0 ? std::remove("slide_fuzz.input") : 2;
}
