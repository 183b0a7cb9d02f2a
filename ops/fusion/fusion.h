#pragma once

#include <memory>

#include "runtime/graph.h"

namespace slide::ops {

/// What fuse() may be told.
struct FusionOptions {
  bool keep_taps = false;    ///< tensors that have a tap are results too: nothing is fused across them
  bool need_kernels = true;  ///< nothing is fused into what no kernel of the baseline level can run
};

/// Writes a graph anew with fewer and larger nodes, which compute the same: in exact arithmetic for every
/// finite input, in float64 up to roundings. It has the inputs, parameters and outputs of `graph` in the same
/// order. A node of the new graph has the name of the node of the old one that makes the same tensor; taps
/// stay where there still is that tensor. Into a convolution go (ops/conv2d/conv2d_method.h, Conv2dFusion):
///
/// - behind it, where each reads the one before and nothing else does:
///   batch norm and affine(): into weight and bias, by nodes on constants that a plan folds in float64;
///   then an add() of a tensor of the same shape (of two convolutions the later one takes the other);
///   then an activation (ops/pointwise/unary_row.h, activation_slope()), or the activation and then the
///   add(). A gated convolution has nothing behind it;
/// - before it, where only convolutions read it: relu(), zero padding, and the upsampling by 2, nearest or
///   bilinear (half-pixel), of 3×3 convolutions that keep the size, also of a concat's first tensor.
///
/// Into a group norm go an add() and an activation behind it, in this order; into a resize an add().
///
/// A 1×1 convolution of an enlarged tensor that nothing else reads becomes the enlargement of a convolution:
/// both are linear, one between channels, the other between pixels with weights that add up to 1, and the
/// small tensor has fewer pixels to multiply.
///
/// Nodes that copy their input (concat of one, resize, slice or reshape to the same shape, affine 1·x + 0)
/// and nodes that no output depends on are left out.
[[nodiscard]] std::unique_ptr<Graph> fuse(const Graph& graph, const FusionOptions& options = {});

}  // namespace slide::ops
