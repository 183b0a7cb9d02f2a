#pragma once

#include <cstddef>
#include <functional>
#include <span>

#include "weights_tools/pickle.h"

namespace slide {

/// Hands out the elements of a strided view in row-major order, in blocks of at most 1 MB. The view must lie
/// within the storage (read_pickle checks that) and have at least one element.
void for_each_strided_block(std::span<const std::byte> storage, std::size_t element_size,
                            const PickleTensor& view,
                            const std::function<void(std::span<const std::byte>)>& take);

}  // namespace slide
