#include "benchmarks/eval/result.h"

#include <chrono>

#include "benchmarks/eval/flip.h"
#include "benchmarks/eval/image_metrics.h"
#include "graphs/lpips.h"
#include "render/photo_layers.h"
#include "runtime/fast_executor.h"

namespace slide::eval {

graphs::LayeringParams LayeringChoice::params(double parallax) const {
  graphs::LayeringParams out{.parallax = parallax, .sigma = sigma, .maxpool = maxpool};
  if (beta) out.beta = *beta * parallax * parallax;
  if (gamma) out.gamma = *gamma * parallax;
  if (rho && parallax > 0) out.rho = *rho / parallax;
  return out;
}

double lpips_distance(const Image& a, const Image& b, const WeightSource& weights) {
  Graph g;
  const Shape shape{1, 3, a.height, a.width};
  g.output("distance", graphs::lpips_alex(g.input("a", shape), g.input("b", shape)));
  FastExecutor run(g, weights);
  run.run({{"a", tensor_from_image(a)}, {"b", tensor_from_image(b)}});
  return static_cast<double>(run.tensor("distance").data<float>()[0]);
}

std::vector<Figure> compare(const Image& view, const Image& truth, const Image& mask,
                            const WeightSource* lpips) {
  std::vector<Figure> figures = {{"psnr", psnr(view, truth, mask)},
                                 {"ssim", ssim(view, truth, mask)},
                                 {"ms_ssim", ms_ssim(view, truth, mask)},
                                 {"gmsd", gmsd(view, truth, mask)},
                                 {"flip", flip(view, truth, mask)}};
  if (lpips != nullptr)
    figures.push_back({"lpips", lpips_distance(cropped(view, kBorder), cropped(truth, kBorder), *lpips)});
  return figures;
}

TimedLayers timed_layers(const graphs::SlideInput& input, const graphs::SlideModels& models,
                         const Settings& settings, double parallax, graphs::MatteUse matte) {
  graphs::SlideOptions options;
  options.layering = settings.layering.params(parallax);
  options.matte = matte;
  if (!models.depth.chosen()) options.depth_edges = settings.depth_edges;
  const auto start = std::chrono::steady_clock::now();
  graphs::SlideLayers made = make_layers(input, models, options);
  const std::chrono::duration<double> took = std::chrono::steady_clock::now() - start;
  return {std::move(made), took.count()};
}

}  // namespace slide::eval
