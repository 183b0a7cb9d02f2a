// Writes the files that the checks outside of the test program look at: make_samples FOLDER.

#include <cstdio>
#include <filesystem>
#include <string>

#include "render/gltf.h"
#include "render/html.h"
#include "runtime/error.h"
#include "tests/render/sample_scene.h"

int main(int argc, char** argv) {
  if (argc != 2) return 2;
  try {
    const std::filesystem::path folder(argv[1]);
    std::filesystem::create_directories(folder);
    const auto file = [&folder](const char* name) { return (folder / name).string(); };
    const slide::Layers scene = sample_scene(240, 160);
    slide::Layers single;
    single.foreground = scene.foreground;
    const slide::Camera camera = slide::make_camera(240, 160);
    slide::HtmlOptions options;
    options.title = "Sample <scene> & \"more\"";
    options.parallax_percent = 10;
    options.focus = 0;
    slide::write_html(file("far_still.html"), scene, camera, options);
    options.focus = 1;
    slide::write_html(file("near_still.html"), scene, camera, options);
    slide::write_html(file("single.html"), single, camera, options);
    slide::write_glb(file("two_layers.glb"), scene, camera);
    slide::write_glb(file("single.glb"), single, camera);
    slide::GltfOptions full;
    full.mesh_tolerance = 0;
    slide::write_glb(file("full_mesh.glb"), scene, camera, full);
    return 0;
  } catch (const slide::Error& e) {
    std::fprintf(stderr, "%s\n", e.what());
    return slide::exit_code(e.kind());
  }
}
