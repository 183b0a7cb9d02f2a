#include "weights_tools/strided.h"

#include <algorithm>
#include <array>
#include <vector>

#include "runtime/shape.h"

namespace slide {
namespace {

constexpr std::size_t kBlock = std::size_t{1} << 20;

/// Collects short runs into blocks; long ones pass through uncopied.
class Blocks {
 public:
  explicit Blocks(const std::function<void(std::span<const std::byte>)>& take) : take_(take) {}
  void add(std::span<const std::byte> run) {
    while (!run.empty()) {
      const std::size_t n = std::min(run.size(), kBlock - buffer_.size());
      if (buffer_.empty() && n == run.size() && n >= kBlock / 4) {
        take_(run);
      } else if (n == kBlock) {
        take_(run.first(n));
      } else {
        if (buffer_.capacity() == 0) buffer_.reserve(kBlock);
        buffer_.insert(buffer_.end(), run.begin(), run.begin() + static_cast<std::ptrdiff_t>(n));
        if (buffer_.size() == kBlock) flush();
      }
      run = run.subspan(n);
    }
  }
  void flush() {
    if (!buffer_.empty()) take_(buffer_);
    buffer_.clear();
  }

 private:
  const std::function<void(std::span<const std::byte>)>& take_;
  std::vector<std::byte> buffer_;
};

}  // namespace

void for_each_strided_block(std::span<const std::byte> storage, std::size_t element_size,
                            const PickleTensor& view,
                            const std::function<void(std::span<const std::byte>)>& take) {
  // The trailing axes that lie densely in the storage make one run of elements; the odometer turns over the
  // others.
  std::size_t axes = view.sizes.size();
  std::uint64_t run = 1;
  while (axes > 0 && (view.sizes[axes - 1] == 1 || view.strides[axes - 1] == run)) run *= view.sizes[--axes];
  const auto run_bytes = static_cast<std::size_t>(run) * element_size;

  Blocks blocks(take);
  std::array<std::uint64_t, Shape::kMaxRank> index{};
  std::uint64_t at = view.offset;
  for (;;) {
    blocks.add(storage.subspan(static_cast<std::size_t>(at) * element_size, run_bytes));
    std::size_t axis = axes;
    while (axis > 0 && ++index[axis - 1] == view.sizes[axis - 1]) {
      --axis;
      index[axis] = 0;
      at -= (view.sizes[axis] - 1) * view.strides[axis];
    }
    if (axis == 0) break;
    at += view.strides[axis - 1];
  }
  blocks.flush();
}

}  // namespace slide
