/* The drive, compiled for a computer: bytes of the axis on stdin, bytes of the drive on stdout. */
#include <stdio.h>

#include "../rate_loop/drive.h"

static drive the_drive;

size_t line_room(void) {
    return 2 * GSID_LINK_FRAME_MAX;
}

void line_send(const uint8_t *bytes, size_t n_bytes) {
    fwrite(bytes, 1, n_bytes, stdout);
}

static void background(void) {
    while (drive_background(&the_drive)) {
    }
}

int main(void) {
    if (drive_init(&the_drive) != GSID_OK) {
        return 1;
    }
    background();
    for (int byte; (byte = getchar()) != EOF;) {
        if (drive_receive(&the_drive, (uint8_t)byte)) {
            drive_tick(&the_drive, 0);
            background();
            drive_tick(&the_drive, 0); /* a run begins with a tick */
            background();
        }
    }
    return 0;
}
