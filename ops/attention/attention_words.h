#pragma once

#include <cstdint>
#include <span>

#include "runtime/cpu.h"

namespace slide::ops {

/// One head's matrices as words of two bfloat16 each, the first in the low half, and a block of its queries.
struct AttentionWords {
  const float* query;        ///< float32, channels × positions, at the first query of the block
  const float* key_words;    ///< keys × channels, as pack_keys() makes them
  const float* value_words;  ///< channels × keys, as pack_values() makes them
  float* output;             ///< at the first query of the block
  std::int64_t depth, value_depth;
  std::int64_t queries;  ///< of the tensors: the distance of neighbouring channels
  std::int64_t keys;
  float scale;
};

/// attention() with products of bfloat16 and sums of float32, for one level whose processors multiply those,
/// after the same plan as AttentionBlockRoutines. Both products have the queries of a block as columns.
/// Channels are filled up with zeros to whole kDepth, keys to whole kFilledKeys, values' channels to whole
/// kRows.
struct AttentionWordsRoutines {
  static constexpr std::int64_t kKeys = 128;  ///< keys of a block
  static constexpr std::int64_t kQueries = 32;
  static constexpr std::int64_t kRows = 32;
  static constexpr std::int64_t kDepth = 32;
  static constexpr std::int64_t kFilledKeys = 32;
  [[nodiscard]] static constexpr std::int64_t filled(std::int64_t n, std::int64_t whole) {
    return (n + whole - 1) / whole * whole;
  }
  /// Words of a key, of a channel of values, and the number of these channels.
  [[nodiscard]] static constexpr std::int64_t key_words(std::int64_t depth) {
    return filled(depth, kDepth) / 2;
  }
  [[nodiscard]] static constexpr std::int64_t value_words(std::int64_t keys) {
    return filled(keys, kFilledKeys) / 2;
  }
  [[nodiscard]] static constexpr std::int64_t value_rows(std::int64_t value_depth) {
    return filled(value_depth, kRows);
  }
  /// Numbers that block() wants: words of queries, results, words of weights, scores.
  [[nodiscard]] static constexpr std::int64_t scratch(std::int64_t depth, std::int64_t value_depth) {
    return (key_words(depth) + value_rows(value_depth) + kKeys / 2 + kKeys) * kQueries;
  }

  Isa isa;
  /// kFilledKeys keys from `first`, of a head's channels × keys.
  void (*pack_keys)(const float* key, std::int64_t depth, std::int64_t keys, std::int64_t first,
                    float* words);
  /// One channel's keys.
  void (*pack_values)(const float* value, std::int64_t keys, float* words);
  /// `count` <= kQueries queries.
  void (*block)(const AttentionWords& head, std::int64_t count, float* scratch);
};

/// Those of every level of this build that has some, best first.
[[nodiscard]] std::span<const AttentionWordsRoutines* const> attention_words_routines();

}  // namespace slide::ops
