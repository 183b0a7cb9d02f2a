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
  slide_settings settings;
  slide_settings_init(&settings);
  slide_photo* photo = NULL;
  slide_status status = slide_create(rgb, disparity, kWidth, kHeight, &settings, &photo);
  if (status == SLIDE_OK) status = slide_render(photo, 0, 0, 0, 0, 0, view);
  if (status == SLIDE_OK && argc == 2) status = slide_export(photo, argv[1]);
  if (status != SLIDE_OK) fprintf(stderr, "use_c: %s\n", slide_last_error());
  slide_free(photo);
  if (status != SLIDE_OK) return (int)status;
  const float middle = view[3 * (kHeight / 2 * kWidth + kWidth / 2)];
  if (middle < 0.49F || middle > 0.51F) return 1;
  printf("SLIDE %s\n", slide_version());
  return 0;
}
