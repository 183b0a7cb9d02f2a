#pragma once

#include "ops/fusion/draft.h"

namespace slide::ops {

// The steps of fuse(). Each looks at one node and changes the draft or leaves it alone.

/// Leaves out a node that copies its input.
void leave_out_copy(Draft& draft, int i);

/// Node i behind a convolution that nothing else reads: the node becomes that convolution with batch norm or
/// affine() folded into its constants, with a residual, or with an activation. Behind a group norm, a
/// residual and an activation; behind a resize, a residual.
void fuse_behind(Draft& draft, int i);

/// Node i, a 1×1 convolution of an enlarged tensor that nothing else reads: the node becomes the resize, of a
/// convolution of the small tensor.
void convolve_before_resize(Draft& draft, int i);

/// Node i, relu(), zero padding, upsampling by 2, or a concat of what was so upsampled bilinearly and another
/// tensor, that only convolutions read: they do it themselves.
void fuse_before(Draft& draft, int i);

}  // namespace slide::ops
