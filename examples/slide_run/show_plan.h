#pragma once

#include <cstddef>

#include "graphs/slide.h"

namespace slide::run {

/// Prints, for every stage, each node of the fused graph with its operator, kernel and shape, its
/// multiply-accumulates done and nominal (millions) and its place in the arena in bytes, all tensors being
/// planar (NCHW); then the memory of the largest stage.
void print_plan(int height, int width, const graphs::SlideModels& models, const graphs::SlideInput& known,
                const graphs::SlideOptions& options);

/// What the program and its libraries held when this was first called, in bytes: main() does so at its start.
std::size_t resident_at_start();

/// An upper estimate in bytes of what a photo needs from reading to writing: the largest stage's plan, and
/// the layers, maps and meshes that are alive beside it.
/// @param photo_pixels  of the photo as it is in the file
/// @param height, width  as it is worked on
[[nodiscard]] std::size_t planned_memory(std::size_t photo_pixels, int height, int width,
                                         const graphs::SlideModels& models, const graphs::SlideInput& known,
                                         const graphs::SlideOptions& options);

}  // namespace slide::run
