/* mesorig-read-picture runs LibRaw and FFmpeg for other programs; see picture_child.h. */
#include "raw.h"
#include "video.h"

#define RAW_CPU_S   120 /* processor time for one picture */
#define VIDEO_CPU_S 3600

int main(int argc, char **argv) {
    if (argc > 1 && g_str_equal(argv[1], "video"))
        picture_child_main(argc, argv, VIDEO_CPU_S, video_child_read);
    picture_child_main(argc, argv, RAW_CPU_S, raw_child_read);
}
