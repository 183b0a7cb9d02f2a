/* A photo becomes a page and one view of it, through the C API.
 *   c_example photo.jpg page.html view.ppm
 * With an installed SLIDE:
 *   cc example.c $(pkg-config --cflags slide) $(pkg-config --static --libs slide) -o c_example */
#include <slide/slide.h>
#include <stdio.h>
#include <stdlib.h>

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
static int write_ppm(const char* path, const unsigned char* rgb, int width, int height) {
  FILE* file = fopen(path, "wb");
  if (file == NULL) return 0;
  const size_t size = 3 * (size_t)width * (size_t)height;
  fprintf(file, "P6\n%d %d\n255\n", width, height);
  const int written = fwrite(rgb, 1, size, file) == size;
  return fclose(file) == 0 && written;
}

/* Draws the photo from a little to the right. */
static slide_status draw(slide_photo* photo, const char* path) {
  int width = 0;
  int height = 0;
  slide_photo_size(photo, &width, &height);
  unsigned char* rgb = malloc(3 * (size_t)width * (size_t)height);
  if (rgb == NULL) return SLIDE_OUT_OF_MEMORY;
  const slide_buffer view = {rgb, width, height, 3, SLIDE_UINT8, 0};
  const slide_view right = slide_view_at(0.03, 0, 0);
  slide_status status = slide_render(photo, &right, &view);
  if (status == SLIDE_OK && !write_ppm(path, rgb, width, height)) {
    fprintf(stderr, "c_example: %s cannot be written\n", path);
    status = SLIDE_OUTPUT;
  }
  free(rgb);
  return status;
}

int main(int argc, char** argv) {
  if (argc != 4) {
    fprintf(stderr, "usage: c_example photo.jpg page.html view.ppm (SLIDE %s)\n", slide_version());
    return SLIDE_USAGE;
  }
  slide_settings settings;
  slide_settings_init(&settings, sizeof settings);
  settings.progress = report;
  slide_model* model = NULL;
  slide_status status = slide_model_create(&settings, &model);
  if (status != SLIDE_OK) return failed("the networks", status);

  slide_scene scene;
  slide_scene_init(&scene, sizeof scene);
  scene.parallax_percent = 5;
  slide_photo* photo = NULL;
  status = slide_open(model, argv[1], &scene, &photo);
  if (status != SLIDE_OK) failed(argv[1], status);
  if (status == SLIDE_OK) {
    status = slide_export(photo, argv[2], NULL);
    if (status != SLIDE_OK) failed(argv[2], status);
  }
  if (status == SLIDE_OK) {
    status = draw(photo, argv[3]);
    if (status != SLIDE_OK) failed("drawing", status);
  }
  slide_photo_free(photo);
  slide_model_free(model);
  return (int)status;
}
