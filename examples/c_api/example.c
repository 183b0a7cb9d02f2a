/* A photo becomes a page and one view of it, through the C API.
 *   c_example photo.jpg page.html view.ppm */
#include <stdio.h>
#include <stdlib.h>

#include "examples/c_api/slide.h"

static int report(void* user, const char* stage, double part) {
  (void)user;
  if (part == 0) fprintf(stderr, "%s\n", stage);
  return 1; /* go on */
}

static int failed(const char* what, slide_status status) {
  fprintf(stderr, "c_example: %s: %s\n", what, slide_last_error());
  return (int)status;
}

/* Writes an image as a binary PPM. */
static int write_ppm(const char* path, const float* rgb, int width, int height) {
  FILE* file = fopen(path, "wb");
  if (file == NULL) return 0;
  fprintf(file, "P6\n%d %d\n255\n", width, height);
  for (size_t i = 0; i < 3 * (size_t)width * (size_t)height; ++i) {
    const float v = rgb[i] < 0 ? 0 : rgb[i] > 1 ? 1 : rgb[i];
    fputc((int)(255 * v + 0.5F), file);
  }
  return fclose(file) == 0;
}

int main(int argc, char** argv) {
  if (argc != 4) {
    fprintf(stderr, "usage: c_example photo.jpg page.html view.ppm (SLIDE %s)\n", slide_version());
    return SLIDE_USAGE;
  }
  slide_settings settings;
  slide_settings_init(&settings);
  settings.parallax_percent = 5;
  settings.progress = report;

  slide_photo* photo = NULL;
  slide_status status = slide_open(argv[1], &settings, &photo);
  if (status != SLIDE_OK) return failed(argv[1], status);

  status = slide_export(photo, argv[2]);
  if (status != SLIDE_OK) {
    slide_free(photo);
    return failed(argv[2], status);
  }

  int width = 0;
  int height = 0;
  slide_size(photo, &width, &height);
  float* rgb = malloc(3 * sizeof(float) * (size_t)width * (size_t)height);
  status = rgb == NULL ? SLIDE_OUT_OF_MEMORY : slide_render(photo, 0.03, 0, 0, 0, 0, rgb);
  if (status == SLIDE_OK && !write_ppm(argv[3], rgb, width, height)) {
    fprintf(stderr, "c_example: %s cannot be written\n", argv[3]);
    status = SLIDE_USAGE;
  } else if (status != SLIDE_OK) {
    failed("drawing", status);
  }
  free(rgb);
  slide_free(photo);
  return (int)status;
}
