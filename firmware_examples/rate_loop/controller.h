/* A rate controller as a drive might have it: proportional and integral, its command within a limit. */
#ifndef CONTROLLER_H
#define CONTROLLER_H

typedef struct {
    float kp;       /* command per deg/s */
    float ki;       /* command per deg/s and tick */
    float limit;    /* of the command */
    float integral; /* state */
} rate_controller;

/* One tick: the command from the wanted and the measured rate. The integral stands still while the command is at its
 * limit, so that it has nothing to unwind. */
static inline float rate_controller_step(rate_controller *c, float wanted, float measured) {
    const float error = wanted - measured;
    const float integral = c->integral + c->ki * error;
    const float command = c->kp * error + integral;
    if (command > c->limit) {
        return c->limit;
    }
    if (command < -c->limit) {
        return -c->limit;
    }
    c->integral = integral;
    return command;
}

#endif
