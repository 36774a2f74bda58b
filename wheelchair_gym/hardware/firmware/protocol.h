/* What host and boards say to each other: frames, messages, parameters, faults.
 *
 * A frame is COBS(version, kind, sequence, payload, CRC-32 of all before it), ended by a zero byte.
 * Numbers are little-endian; CRC-32 is that of IEEE 802.3 (zlib). A random wrong frame passes with
 * probability 2^-32. Zero bytes between frames are allowed, and one is sent ahead of each frame of
 * the host, so that noise before it costs that noise only.
 *
 * The tables below are the one definition: the structs, the parameter stores and the text that the
 * tests compare with the host's protocol.py all come from them.
 */
#ifndef PROTOCOL_H
#define PROTOCOL_H

#include <stdbool.h>
#include <stdint.h>

#define PROTOCOL_VERSION 3
#define BAUD 500000UL /* exact at 16 MHz; 115200 would be 2 % off */

#define HEAD_SIZE 3     /* version, kind, sequence */
#define CRC_SIZE 4
#define PAYLOAD_MAX 56
#define BODY_MAX (HEAD_SIZE + PAYLOAD_MAX + CRC_SIZE)
#define ENCODED_MAX (BODY_MAX + 1) /* COBS adds one byte to fewer than 254 */

#define RANGERS 10 /* at most; `n_rangers` says how many the board has */

/* type, field, scale and unit of one step */

/* host to drive board: the target twist; counts as a sign of life */
#define COMMAND 0x01
#define COMMAND_LAYOUT(F)               \
    F(int16_t, v, "1e-4 m/s")           \
    F(int16_t, w, "1e-4 rad/s")         \
    F(uint8_t, flags, "1")              /* COMMAND_FLAGS */

/* host to drive board: a person says that faults are seen to; drivers may be enabled again */
#define REARM 0x02
#define REARM_LAYOUT(F) F(uint16_t, faults, "1") /* the faults seen: others that stand refuse it */

/* host to board: ask for one parameter, set one, keep all over power-off */
#define GET 0x03
#define GET_LAYOUT(F) F(uint8_t, number, "1")
#define SET 0x04
#define SET_LAYOUT(F)         \
    F(uint8_t, number, "1")    \
    F(float, value, "1")
#define SAVE 0x05
#define SAVE_LAYOUT(F)
#define IDENTIFY 0x06
#define IDENTIFY_LAYOUT(F)

/* drive board to host, 50 Hz */
#define ODOMETRY 0x81
#define ODOMETRY_LAYOUT(F)                                                              \
    F(uint32_t, stamp, "1e-3 s")       /* since the board's reset */                    \
    F(int32_t, left, "1")              /* encoder counts */                             \
    F(int32_t, right, "1")                                                              \
    F(int16_t, speed_left, "1e-4 m/s") /* low-passed, at the rims */                    \
    F(int16_t, speed_right, "1e-4 m/s")                                                 \
    F(int16_t, v, "1e-4 m/s")          /* set point, after limits */                    \
    F(int16_t, w, "1e-4 rad/s")                                                         \
    F(int16_t, duty_left, "1e-4")                                                       \
    F(int16_t, duty_right, "1e-4")                                                      \
    F(uint16_t, battery, "1e-3 V")                                                      \
    F(uint8_t, mode, "1")              /* MODES */                                      \
    F(uint16_t, faults, "1")           /* FAULTS, latched */                            \
    F(uint8_t, switches, "1")          /* SWITCHES, any since the last odometry */      \
    F(uint8_t, echo, "1")              /* sequence of the last command accepted */      \
    F(uint8_t, age, "1e-3 s")          /* of that command, at most 255 ms */            \
    F(uint16_t, bad, "1")              /* frames refused since reset */                 \
    F(uint8_t, lost, "1")              /* bytes and frames dropped for want of room */

/* range board to host, after each firing: all RANGERS, in the order of mounting */
#define RANGES 0x82
#define RANGES_LAYOUT(F)                                                   \
    F(uint32_t, stamp, "1e-3 s")                                           \
    F(uint16_t, bad, "1")                                                  \
    F(range_t, ranges, "1e-3 m, 1e-3 s, 1") /* range, age, RANGE_STATUS */

/* board to host: the answer to GET and SET */
#define PARAMETER 0x83
#define PARAMETER_LAYOUT(F)                     \
    F(uint8_t, number, "1")                      \
    F(uint8_t, status, "1") /* STATUSES */      \
    F(float, value, "1")                        \
    F(float, low, "1")                          \
    F(float, high, "1")

/* board to host: the answer to REARM and SAVE, and to what cannot be understood */
#define ANSWER 0x84
#define ANSWER_LAYOUT(F)      \
    F(uint8_t, kind, "1")     \
    F(uint8_t, sequence, "1") \
    F(uint8_t, status, "1")   /* STATUSES */

/* board to host: the answer to IDENTIFY, and sent once after a reset */
#define IDENTITY 0x85
#define IDENTITY_LAYOUT(F)                                                \
    F(uint8_t, board, "1")      /* BOARDS */                              \
    F(uint8_t, parameters, "1") /* how many */                            \
    F(uint8_t, cause, "1")      /* of the reset: MCUSR */                 \
    F(uint8_t, stored, "1")     /* 1: EEPROM holds what a host stored */

/* drive board to host, after each odometry, once its joystick's receiver was heard */
#define JOYSTICK 0x86
#define JOYSTICK_LAYOUT(F)                                                  \
    F(int16_t, forward, "1e-4") /* deflection past the dead zone, -1 to 1 */ \
    F(int16_t, left, "1e-4")                                                \
    F(uint8_t, flags, "1")      /* JOYSTICK_FLAGS */                        \
    F(uint8_t, age, "1e-3 s")   /* of its last frame, at most 255 ms */

#define MESSAGES(M)                                                             \
    M(COMMAND) M(REARM) M(GET) M(SET) M(SAVE) M(IDENTIFY) M(ODOMETRY) M(RANGES) \
    M(PARAMETER) M(ANSWER) M(IDENTITY) M(JOYSTICK)

#define PACKED __attribute__((packed))
#define MEMBER(type, name, unit) type name;

typedef struct PACKED {
    uint16_t range; /* mm */
    uint16_t age;   /* ms since the ranger fired, 65535: never, or longer ago */
    uint8_t status; /* RANGE_STATUS */
} range_t;

typedef struct PACKED { COMMAND_LAYOUT(MEMBER) } command_t;
typedef struct PACKED { REARM_LAYOUT(MEMBER) } rearm_t;
typedef struct PACKED { GET_LAYOUT(MEMBER) } get_t;
typedef struct PACKED { SET_LAYOUT(MEMBER) } set_t;
typedef struct PACKED { ODOMETRY_LAYOUT(MEMBER) } odometry_t;
typedef struct PACKED { uint32_t stamp; uint16_t bad; range_t ranges[RANGERS]; } ranges_t;
typedef struct PACKED { PARAMETER_LAYOUT(MEMBER) } parameter_t;
typedef struct PACKED { ANSWER_LAYOUT(MEMBER) } answer_t;
typedef struct PACKED { IDENTITY_LAYOUT(MEMBER) } identity_t;
typedef struct PACKED { JOYSTICK_LAYOUT(MEMBER) } joystick_told_t;

/* Bits and numbers, by name. */
#define COMMAND_FLAGS(N)                                                               \
    N(PROTECTIVE, 0x01)      /* brake at the protective rate, exempt from jerk */      \
    N(ASSISTED, 0x02)        /* a person drives by the joystick and the host helps: at rest while \
                                its dead-man switch is let go, its stick centred or it is silent */

#define JOYSTICK_FLAGS(N)                                                              \
    N(FRESH, 0x01)           /* a frame came within JOYSTICK_TIMEOUT */                \
    N(HELD, 0x02)            /* the switch that must be held to drive */               \
    N(MUST_CENTRE, 0x04)     /* nothing is driven before the stick was at its centre */

#define MODES(N)     \
    N(STOPPED, 0)    /* drivers off, brakes on; a person must re-arm; lever lifted: duty 0 */ \
    N(HOST, 1)       /* the host drives */                   \
    N(MANUAL, 2)     /* the joystick at the board drives */  \
    N(STOPPING, 3)   /* on the way to rest, under control */ \
    N(READY, 4)      /* drivers off, brakes on; the next command drives */

#define FAULTS(N)                                                                      \
    N(RESET, 0x0001)         /* the board has started anew */                          \
    N(EMERGENCY_STOP, 0x0002)                                                          \
    N(LINK, 0x0004)          /* no command for longer than `latch` */                  \
    N(STALL, 0x0008)         /* a wheel is driven and no counts come: stuck, or blind */ \
    N(DIRECTION, 0x0010)     /* a wheel turns against its motor */                     \
    N(ENCODER, 0x0020)       /* steps that no encoder can make */                      \
    N(OVER_SPEED, 0x0040)                                                              \
    N(UNDER_VOLTAGE, 0x0080)                                                           \
    N(DRIVER, 0x0100)        /* a motor driver reports a fault, Hall sensors among them */ \
    N(STORE, 0x0200)         /* EEPROM unreadable: parameters are the defaults; stands until \
                                a host has stored them */                              \
    N(RUNAWAY, 0x0400)       /* a wheel turns faster than its aim, or does not come to rest */ \
    N(BRAKE, 0x0800)         /* the closed brakes have slipped repeatedly */           \
    N(IMPLAUSIBLE, 0x1000)   /* motor voltage and measured speed do not fit together */ \
    N(OVERRUN, 0x2000)       /* the control came too late, once or repeatedly */ \
    N(LEVER, 0x4000)         /* the lever was lifted while the board had the chair */

#define SWITCHES(N)                                              \
    N(STOP_PRESSED, 0x01)    /* emergency stop */                \
    N(FRONT, 0x02)           /* bumper strips */                 \
    N(REAR, 0x04)                                                \
    N(LEFT, 0x08)                                                \
    N(RIGHT, 0x10)                                               \
    N(FREEWHEEL, 0x20)       /* the lever that lifts the brakes */ \
    N(DRIVER_LEFT, 0x40)     /* fault output of the driver */    \
    N(DRIVER_RIGHT, 0x80)

#define RANGE_STATUS(N)                                            \
    N(ECHO, 0)                                                     \
    N(NO_ECHO, 1)            /* nothing within reach */            \
    N(SILENT, 2)             /* the sensor does not answer */      \
    N(UNTRIED, 3)            /* not yet fired since reset */

#define STATUSES(N)                                                      \
    N(DONE, 0)                                                           \
    N(UNKNOWN, 1)            /* no such message or parameter */          \
    N(OUT_OF_RANGE, 2)                                                   \
    N(MOVING, 3)             /* only at rest, with the drivers off */    \
    N(CAUSE_STANDS, 4)       /* of a fault (STORE: none was stored yet), or the lever */ \
    N(NOT_AT_ZERO, 5)        /* needs a fresh command of zero */         \
    N(OTHER_FAULTS, 6)       /* stand than those named */                \
    N(BUSY, 7)

#define BOARDS(N) N(DRIVE_BOARD, 1) N(RANGE_BOARD, 2)

#define NUMBER(name, value) name = value,
enum { COMMAND_FLAGS(NUMBER) };
enum { JOYSTICK_FLAGS(NUMBER) };
enum { MODES(NUMBER) };
enum { FAULTS(NUMBER) };
enum { SWITCHES(NUMBER) };
enum { RANGE_STATUS(NUMBER) };
enum { STATUSES(NUMBER) };
enum { BOARDS(NUMBER) };

#define STRIPS (FRONT | REAR | LEFT | RIGHT)

/* name, default, least, most, unit: floats, in SI units */
#define DRIVE_PARAMETERS(P)                                                            \
    P(track, 0.54F, 0.1F, 2.0F, "m")                                                   \
    P(counts_per_metre, 4346.0F, 50.0F, 100000.0F, "1/m")                              \
    P(forward, 0.8F, 0.05F, 1.0F, "m/s")                                               \
    P(backward, 0.3F, 0.0F, 1.0F, "m/s")                                               \
    P(turn, 1.0F, 0.05F, 2.0F, "rad/s")                                                \
    P(acceleration, 0.5F, 0.05F, 2.0F, "m/s2")                                         \
    P(deceleration, 0.8F, 0.05F, 2.0F, "m/s2")                                         \
    P(protective, 2.2F, 0.5F, 3.0F, "m/s2")     /* of the set point, on command */     \
    P(turn_acceleration, 1.5F, 0.05F, 10.0F, "rad/s2")                                 \
    P(jerk, 1.0F, 0.1F, 100.0F, "m/s3")                                                \
    P(turn_jerk, 6.0F, 0.1F, 100.0F, "rad/s3")                                         \
    P(stop, 2.2F, 1.5F, 3.0F, "m/s2")           /* of the set point, after a fault */  \
    P(feed, 22.424242F, 1.0F, 200.0F, "V s/m")  /* motor constant / wheel radius */    \
    P(kp, 40.0F, 0.0F, 400.0F, "V s/m")                                                \
    P(ki, 120.0F, 0.0F, 4000.0F, "V/m")                                                \
    P(kd, 0.0F, 0.0F, 40.0F, "V s2/m")                                                 \
    P(ka, 3.0F, 0.0F, 40.0F, "V s2/m")                                                 \
    P(smoothing, 0.02F, 0.0F, 0.2F, "s")        /* low-pass of the measured speed */   \
    P(timeout, 0.2F, 0.02F, 0.2F, "s")          /* without command: to rest */         \
    P(latch, 1.0F, 0.2F, 10.0F, "s")            /* without command: LINK */            \
    P(missing, 0.01F, 0.002F, 0.1F, "m")        /* way behind half of the aim: STALL */ \
    P(over_speed, 1.3F, 0.1F, 2.0F, "m/s")      /* at a rim */                         \
    P(under_voltage, 30.0F, 0.0F, 60.0F, "V")                                          \
    P(battery_full, 60.0F, 5.0F, 100.0F, "V")   /* at the ADC's full scale */          \
    P(manual, 0.5F, 0.05F, 1.0F, "1")           /* share of the limits by joystick */  \
    P(creep, 0.1F, 0.0F, 0.3F, "m/s")           /* away from a pressed strip */        \
    P(half_width, 0.31F, 0.1F, 1.0F, "m")       /* of the outline, to the side strips */ \
    P(runaway, 0.25F, 0.1F, 0.5F, "m/s")        /* mean over 0.1 s beyond the aim: RUNAWAY */ \
    P(load, 8.0F, 2.0F, 60.0F, "V")             /* beyond back-EMF, mean of 1 s: IMPLAUSIBLE */ \
    P(hold, 400.0F, 0.0F, 2000.0F, "V/m")       /* position hold at rest */            \
    P(park, 1.0F, 0.2F, 60.0F, "s")             /* at rest: drivers off, brakes on */  \
    P(slip, 0.01F, 0.002F, 0.1F, "m")           /* of a closed brake; three times: BRAKE */ \
    P(duty_limit, 0.95F, 0.5F, 1.0F, "1")       /* bootstrapped drivers cannot hold full duty */

#define RANGE_PARAMETERS(P)                                                            \
    P(interval, 0.06F, 0.05F, 0.5F, "s")        /* between two firings */              \
    P(sound, 343.0F, 300.0F, 380.0F, "m/s")     /* 20 C: 331.3 + 0.606 T */            \
    P(narrow_reach, 4.0F, 0.1F, 6.0F, "m")                                             \
    P(wide_reach, 6.0F, 0.1F, 6.0F, "m")                                               \
    P(narrow_blind, 0.02F, 0.0F, 0.5F, "m")     /* nearer echoes read as this */       \
    P(wide_blind, 0.03F, 0.0F, 0.5F, "m")                                              \
    P(n_rangers, 8.0F, 8.0F, 10.0F, "1")        /* later ones never fire: UNTRIED */

/* Rangers 0 to 3 are of the pulse model (narrow), 4 to 9 of the I2C model (wide); 8 and 9 look back.
 * Those that fire one after another look apart: none listens while its neighbour's sound is in the air. */
#define NARROW_RANGERS 4
#define FIRING_ORDER {0, 4, 1, 5, 9, 2, 6, 3, 7, 8}

#endif
