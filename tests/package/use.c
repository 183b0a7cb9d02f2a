/* The C API from an installed package: a photo in memory becomes a view and a page. use_c page.html */
#include <slide/slide.h>
#include <stdio.h>

enum { kWidth = 32, kHeight = 24 };

int main(int argc, char** argv) {
  static float rgb[kHeight * kWidth * 3], disparity[kHeight * kWidth], view[kHeight * kWidth * 3];
  for (int i = 0; i < kHeight * kWidth; ++i) {
    disparity[i] = (float)(i % kWidth) / kWidth;
    rgb[3 * i] = rgb[3 * i + 1] = rgb[3 * i + 2] = 0.5F;
  }
  const slide_image image = {rgb, kWidth, kHeight, 3, SLIDE_FLOAT32, 0};
  const slide_image map = {disparity, kWidth, kHeight, 1, SLIDE_FLOAT32, 0};
  const slide_buffer buffer = {view, kWidth, kHeight, 3, SLIDE_FLOAT32, 0};
  const slide_view straight = slide_view_at(0, 0, 0);
  slide_model* model = NULL;
  slide_photo* photo = NULL;
  slide_status status = slide_model_create(NULL, &model);
  if (status == SLIDE_OK) status = slide_make(model, &image, &map, NULL, NULL, &photo);
  if (status == SLIDE_OK) status = slide_render(photo, &straight, &buffer);
  if (status == SLIDE_OK && argc == 2) status = slide_export(photo, argv[1], NULL);
  if (status != SLIDE_OK) fprintf(stderr, "use_c: %s\n", slide_last_error());
  slide_photo_free(photo);
  slide_model_free(model);
  if (status != SLIDE_OK) return (int)status;
  const float middle = view[3 * (kHeight / 2 * kWidth + kWidth / 2)];
  if (middle < 0.49F || middle > 0.51F) return 1;
  printf("SLIDE %s\n", slide_version());
  return 0;
}
