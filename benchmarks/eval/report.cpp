#include "benchmarks/eval/report.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>

#include "render/write_image.h"
#include "runtime/error.h"

namespace slide::eval {
namespace {

constexpr int kCutWidth = 144;
constexpr int kCutHeight = 144;

void print_header(const std::vector<Figure>& figures) {
  std::printf("%-28s", "");
  for (const Figure& f : figures)
    std::printf(" %*s", static_cast<int>(std::max<std::size_t>(8, f.name.size())), f.name.c_str());
  std::printf(" %8s\n", "seconds");
}

void print_row(const std::string& method, const std::vector<Figure>& figures, double seconds) {
  std::printf("%-28s", method.c_str());
  for (const Figure& f : figures) {
    const int width = static_cast<int>(std::max<std::size_t>(8, f.name.size()));
    std::printf(" %*.*f", width, f.name.starts_with("psnr") ? 2 : 4, f.value);
  }
  std::printf(" %8.2f\n", seconds);
}

/// The entry with most figures: its names head the table.
const std::vector<Figure>& widest(const std::vector<Entry>& entries) {
  return std::ranges::max_element(entries, {}, [](const Entry& e) { return e.figures.size(); })->figures;
}

/// A method's means over the scenes that have it, figure by figure where it is a number.
struct Mean {
  std::string method;
  std::vector<Figure> figures;
  double seconds = 0;
  int scenes = 0;
};

void add_to(Mean& mean, const Entry& entry, std::map<std::string, int>& counts) {
  for (const Figure& f : entry.figures) {
    if (std::isnan(f.value)) continue;
    auto found = std::ranges::find(mean.figures, f.name, &Figure::name);
    if (found == mean.figures.end()) found = mean.figures.insert(found, {f.name, 0});
    found->value += f.value;
    ++counts[f.name];
  }
  mean.seconds += entry.seconds;
  ++mean.scenes;
}

std::vector<Mean> means_of(const std::vector<SceneResult>& results, const std::string& kind) {
  std::vector<Mean> means;
  std::map<std::string, std::map<std::string, int>> counts;
  for (const SceneResult& r : results) {
    if (r.kind != kind) continue;
    for (const Entry& e : r.entries) {
      auto found = std::ranges::find(means, e.method, &Mean::method);
      if (found == means.end()) found = means.insert(found, {e.method, {}, 0, 0});
      add_to(*found, e, counts[e.method]);
    }
  }
  for (Mean& m : means) {
    for (Figure& f : m.figures) f.value /= counts[m.method][f.name];
    m.seconds /= m.scenes;
  }
  return means;
}

std::vector<std::string> kinds(const std::vector<SceneResult>& results) {
  std::vector<std::string> out;
  for (const SceneResult& r : results)
    if (std::ranges::find(out, r.kind) == out.end()) out.push_back(r.kind);
  return out;
}

/// The part of the picture with most pixels of interest.
struct Corner {
  int x, y;
};
Corner richest(const Image& interesting, int width, int height) {
  Corner best{0, 0};
  double most = -1;
  for (int y = 0; y + height <= interesting.height; y += 8)
    for (int x = 0; x + width <= interesting.width; x += 8) {
      double count = 0;
      for (int v = y; v < y + height; ++v)
        for (int u = x; u < x + width; ++u) count += static_cast<double>(interesting.at(u, v));
      if (count > most) most = count, best = {x, y};
    }
  return best;
}

nlohmann::json figures_json(const std::vector<Figure>& figures) {
  nlohmann::json out = nlohmann::json::object();
  for (const Figure& f : figures) out[f.name] = f.value;
  return out;
}

}  // namespace

void print(const SceneResult& r) {
  std::printf("\n%s (%s)", r.name.c_str(), r.kind.c_str());
  for (const Figure& f : r.facts) std::printf("  %.1f %% %s", 100 * f.value, f.name.c_str());
  std::printf("\n");
  if (r.entries.empty()) return;
  print_header(widest(r.entries));
  for (const Entry& e : r.entries) print_row(e.method, e.figures, e.seconds);
}

void print_means(const std::vector<SceneResult>& results) {
  for (const std::string& kind : kinds(results)) {
    const std::vector<Mean> means = means_of(results, kind);
    if (means.empty()) continue;
    std::printf("\nmeans (%s)\n", kind.c_str());
    print_header(
        std::ranges::max_element(means, {}, [](const Mean& m) { return m.figures.size(); })->figures);
    for (const Mean& m : means) print_row(m.method, m.figures, m.seconds);
  }
}

nlohmann::json to_json(const std::vector<SceneResult>& results) {
  nlohmann::json scenes = nlohmann::json::array();
  for (const SceneResult& r : results) {
    nlohmann::json methods = nlohmann::json::object();
    for (const Entry& e : r.entries) {
      methods[e.method] = figures_json(e.figures);
      methods[e.method]["seconds"] = e.seconds;
    }
    nlohmann::json scene = figures_json(r.facts);
    scene["kind"] = r.kind;
    scene["scene"] = r.name;
    scene["methods"] = methods;
    scenes.push_back(scene);
  }
  nlohmann::json means = nlohmann::json::object();
  for (const std::string& kind : kinds(results))
    for (const Mean& m : means_of(results, kind)) {
      nlohmann::json& method = means[kind][m.method] = figures_json(m.figures);
      method["seconds"] = m.seconds;
      method["scenes"] = m.scenes;
    }
  return {{"scenes", scenes}, {"means", means}};
}

void write_pictures(const std::string& folder, const SceneResult& r) {
  std::error_code failure;
  std::filesystem::create_directories(folder, failure);
  if (failure)
    throw Error(ErrorKind::kOutput, "the folder " + folder + " cannot be made: " + failure.message());
  const auto file = [&](std::string name) {
    std::erase(name, ',');
    std::ranges::replace(name, ' ', '_');
    return folder + "/" + name;
  };
  const int width = std::min(kCutWidth, r.truth.width);
  const int height = std::min(kCutHeight, r.truth.height);
  const Corner corner = richest(r.interesting, width, height);
  std::vector<const Image*> views = {&r.truth};
  for (const Entry& e : r.entries) {
    views.push_back(&e.view);
    write_png(file(r.name + "_" + e.method + ".png"), e.view);
  }
  Image strip(width * static_cast<int>(views.size()), height, 3);
  for (std::size_t i = 0; i < views.size(); ++i)
    for (int y = 0; y < height; ++y)
      std::copy_n(views[i]->data.data() + views[i]->index(corner.x, corner.y + y), 3 * width,
                  strip.data.data() + strip.index(width * static_cast<int>(i), y));
  write_jpeg(file(r.name + ".jpg"), strip, 90);
}

}  // namespace slide::eval
