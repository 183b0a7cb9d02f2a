#pragma once

#include <cstdint>
#include <span>

#include "runtime/cpu.h"

namespace slide::ops {

/// One head's matrices, channels × positions.
struct AttentionHead {
  const float* query;  ///< at the first query of the block
  const float* key;
  const float* value;
  float* output;  ///< at the first query of the block
  std::int64_t depth, value_depth;
  std::int64_t queries, keys;  ///< of the tensors: the distance of neighbouring channels
  float scale;
};

/// Attention of a block of queries, for one instruction-set level: keys go by in blocks, and only the scores
/// of a block are in memory (Milakov and Gimelshein 2018; Dao et al. 2022).
struct AttentionBlockRoutines {
  static constexpr std::int64_t kKeys = 128;  ///< keys of a block
  Isa isa;
  std::int64_t lanes;  ///< queries of a block
  /// `count` <= lanes queries. scratch: (depth + value_depth + kKeys) · lanes numbers.
  void (*block)(const AttentionHead& head, std::int64_t count, float* scratch);
};

/// Those of every level of this build, best first.
[[nodiscard]] std::span<const AttentionBlockRoutines* const> attention_block_routines();

}  // namespace slide::ops
