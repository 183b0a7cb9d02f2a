#pragma once

#include <memory>

#include "weights_tools/weight_reader.h"

namespace slide {

/// Whether the tensors are named as Hugging Face's transformers library names Depth Anything's
/// (DepthAnythingForDepthEstimation; the files of the "-hf" repositories).
[[nodiscard]] bool has_transformers_names(const WeightReader& reader);

/// The same tensors under the names of Depth Anything's authors, as that library's
/// models/depth_anything/convert_depth_anything_to_hf.py pairs them; query, key and value of each block
/// joined to qkv. Names that the pairs do not cover stay. Throws Error(kBadWeights) if one of query, key and
/// value is missing, their types or shapes do not fit together, or two tensors come to one name.
[[nodiscard]] std::unique_ptr<WeightReader> with_authors_names(std::unique_ptr<WeightReader> reader);

}  // namespace slide
