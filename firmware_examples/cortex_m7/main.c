/* Bare metal: the drive of rate_loop on a Cortex-M7 or M4F, in lock-step with an axis at the other end of the serial line.
 *
 * The tick is the SysTick exception. On a rig the timer triggers it 3000 times a second, and the tick reads the sensor. Here
 * the sensor is at the other end of the line: the arrival of a sample triggers the exception, and the timer only measures
 * silence. */
#include "../rate_loop/drive.h"
#include "board.h"

static drive the_drive;

void on_byte(uint8_t byte) {
    if (drive_receive(&the_drive, byte)) {
        board_request_tick();
    }
}

void on_tick(int by_timer) {
    drive_tick(&the_drive, by_timer);
}

int main(void) {
    if (drive_init(&the_drive) != GSID_OK) {
        return 1;
    }
    board_init(EXPERIMENT_FS_HZ);
    for (;;) {
        if (!drive_background(&the_drive)) {
            board_sleep();
        }
    }
}
