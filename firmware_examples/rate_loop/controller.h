/* A typical rate controller of a drive: proportional and integral, with a limited command. */
#ifndef CONTROLLER_H
#define CONTROLLER_H

typedef struct {
    float kp;       /* command per deg/s */
    float ki;       /* command per deg/s and tick */
    float limit;    /* of the command */
    float integral; /* state */
} rate_controller;

/* One tick: the command from the reference and the measured rate. The integral is held while the command is at its limit
 * (anti-windup). */
static inline float rate_controller_step(rate_controller *c, float reference, float measured) {
    const float error = reference - measured;
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
