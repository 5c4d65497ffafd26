from __future__ import annotations

from math import sqrt

from ..bases.boom import X_AXIS, Y_AXIS, Z_AXIS, Boom
from ..contract.block import Mat33, Output, Parameter, Table, Vec3
from ..laws import firing
from ..laws import gravity_gradient as laws
from ..maths.attitude import inverse, matrix, product, propagated, rotate
from ..maths.vector import ZERO, add, clip, cross, dot, mat_vec, norm, scale, sub
from ..physics.gyrostat import inverse_inertia
from ..physics.wheel_array import body_momentum

ONE, TWO, THREE = range(3)
ENTRIES = 8


class ManagerBoomFeedforward(Boom):
    """x"""

    wheels: int = Parameter("1", "wheels", choices=("z", "y_z", "x_y_z"), start="x_y_z")
    inertia: Mat33 = Parameter("kg.m2", "inertia", start=(153.0, 0.25, -0.1, 0.25, 153.0, -0.0005, -0.1, -0.0005, 5.0), shared=True)
    schedule_start: Table = Parameter("s", "start", shape=(ENTRIES,), shared=True)
    schedule_duration: Table = Parameter("s", "dur", shape=(ENTRIES,), min=0.0, shared=True)
    schedule_tau_body: Table = Parameter("N.m", "tau", shape=(ENTRIES, 3), shared=True)
    firing_uncertainty: float = Parameter("1", "rel", start=0.3, min=0.0)
    learning: bool = Parameter("1", "learn", start=True)
    learning_time: float = Parameter("s", "after firing", start=300.0, min=0.0)
    feedforward: bool = Parameter("1", "ff", start=True)
    torque_limit: float = Parameter("N.m", "limit", start=5e-3, min=0.0)
    bandwidth: Vec3 = Parameter("rad/s", "PD", start=(0.02, 0.02, 0.04), min=0.0)
    damping: float = Parameter("1", "zeta", start=1.0, min=0.0)
    gyro_noise: float = Parameter("rad/s", "of rate", start=3.5e-5, min=1e-9)
    attitude_gain: float = Parameter("1", "part of the measured attitude", start=0.1, min=0.0, max=1.0)
    torque_noise: Vec3 = Parameter("N.m", "unknown", start=(1e-5, 1e-5, 1e-5), min=0.0)
    m_limit: float = Parameter("A.m2", "coil", start=3.604, min=1e-6)
    duty_max: float = Parameter("1", "duty", start=0.8, min=0.0, max=1.0)
    least_pulse: float = Parameter("s", "pulse", start=0.2, min=1e-6)
    gain_tilt: Vec3 = Parameter("A.m2/rad", "of tilt", min=0.0)
    gain_rate: Vec3 = Parameter("A.m2.s/rad", "of tilt rate", min=0.0)
    gain_dump: Vec3 = Parameter("1/(T.s)", "of h", start=150.0, min=0.0)
    h_deadband: float = Parameter("N.m.s", "dead", start=5e-3, min=0.0)
    deadband: float = Parameter("A.m2", "e dead", start=0.0, min=0.0)
    gain_lean: float = Parameter("rad/(N.m.s)", "tilt ref", start=0.5, min=0.0)
    lean_limit: float = Parameter("rad", "tilt ref", start=4.4e-3, min=0.0)
    mode: int = Output("1", "m", interval=True, choices=("idle", "controlling", "firing"))

    def start(self) -> None:
        super().start()
        self._inverse = inverse_inertia(self.inertia)
        self._moments = (self.inertia[0], self.inertia[4], self.inertia[8])
        self._omega = None
        self._q = (0.,0.,0.,1.)
        self._variance = ZERO
        self._h_before = ZERO
        self._impulse = ZERO   # known, over the last sample
        self._found = ZERO
        self._learnt = ZERO
        self._fired = -1
        self._t_before = 0.0
        self.mode = 0
        self._has = ((0.,0.,1.),(0.,1.,1.),(1.,1.,1.))[self.wheels]

    def hold(self, t):
        self._omega = None
        return ZERO

    def _estimate(self, t):
        h = body_momentum(self.axes_wheel, self.h_wheel)
        if self._omega is None:
            self._omega, self._q = self.omega_bi_body, self.q_bi
            n = self.gyro_noise
            self._variance = (n*n, n*n, n*n)
        else:
            T = t - self._t_before
            w0 = self._omega
            w = firing.predicted_rate(w0, self._h_before, h, self._impulse, self.inertia, self._inverse, T)
            q = propagated(self._q, scale(0.5, add(w0, w)), T)
            innovation = sub(self.omega_bi_body, w)
            gains = []; var = []
            i3 = tuple(min(max(x,-1.),1.) for x in ZERO)
            fire = self._overlap(self._t_before, T)
            size = self.firing_uncertainty * norm(self._firing_torque) * fire
            for i in range(3):
                s = self.torque_noise[i]*T/self._moments[i]
                f = size/self._moments[i]
                p = self._variance[i] + s*s + f*f
                k = firing.gain(p, self.gyro_noise)
                gains.append(k); var.append(p*(1-k))
            self._variance = tuple(var)
            corr = tuple(k*x for k, x in zip(gains, innovation))
            self._omega = add(w, corr)
            e = laws.rotation_vector(product(self.q_bi, inverse(q)))
            self._q = propagated(q, scale(self.attitude_gain, e), 1.0)
            self._found = add(self._found, mat_vec(self.inertia, corr))
        self._h_before, self._t_before = h, t

    def _overlap(self, t, T):
        i = self._fired
        if i < 0: return 0.0
        return firing.overlap(self.schedule_start[i], self.schedule_duration[i], t, T)

    def act(self, t):
        T = self.sample_time
        self._firing_torque = getattr(self, '_firing_torque', ZERO)
        self._estimate(t)
        # firing
        for i in range(ENTRIES):
            d = self.schedule_duration[i]
            if d > 0 and firing.overlap(self.schedule_start[i], d, t, T) > 0 and i != self._fired:
                self._fired = i; self._found = ZERO
        tau_f = ZERO; on = 0.0
        if self._fired >= 0:
            i = self._fired
            s, d = self.schedule_start[i], self.schedule_duration[i]
            nominal = tuple(self.schedule_tau_body[3*i:3*i+3])
            self._firing_torque = nominal
            on = firing.overlap(s, d, t, T)
            past = min(t - s, d)
            tau_f = add(nominal, self._learnt) if self.learning else nominal
            if past > 0 and self.learning:
                tau_f = add(tau_f, scale(1.0/past, self._found))
            if self.learning and t >= s + d + self.learning_time and self._learn_of != i:
                self._learnt = add(self._learnt, scale(1.0/d, self._found)); self._learn_of = i
        impulse_f = scale(on, tau_f) if self.feedforward else ZERO
        qe = product(self._q, inverse(self.q_ref_bi))
        a = matrix(qe)
        w_ref = rotate(qe, self.omega_ref_body)
        w = sub(self._omega, w_ref)
        h = self.momentum()
        e = laws.rotation_vector(qe)
        lim = self.lean_limit
        lean = clip(scale(self.gain_lean, h), lim)
        if abs(e[2])>0.2: lean = ZERO
        b = self.b_body
        # coils
        til = laws.tilt((a[2],a[5],a[8]))
        has = self._has
        hd = h if norm(h) > self.h_deadband else ZERO
        gt, gr, gd = self.gain_tilt, self.gain_rate, self.gain_dump
        ee = tuple((gd[i]*hd[i] if has[i] else 0.0) + (0.0 if has[i] else gt[i]*til[i] + gr[i]*w[i]) for i in range(3))
        m = laws.cross_product(ee, b) if self.enable and norm(ee) > self.deadband else ZERO
        m = tuple(self._pulsed(x) for x in m)
        coil = cross(m, b)
        # wheels
        gyro = cross(self._omega, h)
        tau = []
        for i in range(3):
            if not has[i]: tau.append(0.0); continue
            J = self._moments[i]; wn = self.bandwidth[i]
            err = e[i] - (lean[i] if i < 2 else 0.0)
            x = -J*wn*wn*err - 2*self.damping*wn*J*w[i] - coil[i] - impulse_f[i]/T + gyro[i]
            tau.append(min(max(x,-self.torque_limit), self.torque_limit))
        self.give(m, tuple(tau))
        u = (a[2],a[5],a[8])
        gg = laws.gravity_vector_torque(u, self.inertia, norm(self.omega_ref_body))
        self._impulse = add(scale(T, add(coil, gg)), impulse_f if self.feedforward else scale(on, ZERO))
        self.mode = 2 if on > 0 else 1
    _learn_of = -1

    def _pulsed(self, x):
        T=self.sample_time
        most = int(self.duty_max * T / self.least_pulse + 1e-9)
        c = min(int(abs(x)/self.m_limit*T/self.least_pulse + .5), most)*self.least_pulse/T*self.m_limit
        return c if x>0 else -c
