// All texts of the page: one row a key, one column a language.
const ROWS = {
  title: ["Wheelchair studio", "Estudio de silla de ruedas"],
  skip: ["Skip to the content", "Saltar al contenido"],
  pages: ["Pages", "Páginas"],
  drive: ["Drive", "Conducir"],
  looks: ["Display", "Pantalla"],
  language: ["Language", "Idioma"],
  size: ["Text size", "Tamaño del texto"],
  contrast: ["High contrast", "Alto contraste"],
  still: ["Reduced motion", "Movimiento reducido"],
  loading: ["Loading", "Cargando"],
  load_text: ["Loading the simulator: {seconds} s", "Cargando el simulador: {seconds} s"],
  compile_text: ["Compiling the simulator, once on this machine: {seconds} s, part {kernels} {kernel}",
    "Compilando el simulador, una sola vez en esta máquina: {seconds} s, parte {kernels} {kernel}"],
  busy: ["Preparing the drive", "Preparando el recorrido"],
  lost: ["The connection is lost. The chair has stopped and the drive has ended.",
    "Se perdió la conexión. La silla se ha detenido y el recorrido ha terminado."],
  reconnect: ["Connect again", "Conectar de nuevo"],
  place: ["Place", "Lugar"],
  where: ["Where", "Dónde"],
  scenes: ["Scenes", "Escenas"],
  suites: ["Episodes of suites", "Episodios de las pruebas"],
  maps: ["Your map", "Su mapa"],
  seed: ["Number of the world", "Número del mundo"],
  start: ["Start", "Empezar"],
  next: ["Another world", "Otro mundo"],
  help: ["Help", "Ayuda"],
  assistant: ["Assistant", "Asistente"],
  hand: ["Simulated hand", "Mano simulada"],
  input: ["Input", "Entrada"],
  device: ["Device", "Dispositivo"],
  device_stick: ["Keys, gamepad or touch stick", "Teclas, mando o palanca táctil"],
  device_switch: ["Single switch (space bar)", "Pulsador único (barra espaciadora)"],
  scan_period: ["Time of each command [s]", "Tiempo de cada orden [s]"],
  speed: ["Speed", "Velocidad"],
  rate: ["Pictures a second", "Imágenes por segundo"],
  touch_stick: ["Touch stick: drag to drive, release to stop", "Palanca táctil: arrastre para conducir, suelte para parar"],
  switch: ["Switch", "Pulsador"],
  scan: ["Commands of the switch", "Órdenes del pulsador"],
  forward: ["forward", "adelante"], left: ["left", "izquierda"], right: ["right", "derecha"], back: ["back", "atrás"],
  stop: ["End the drive", "Terminar el recorrido"],
  pause: ["Pause", "Pausa"], resume: ["Go on", "Continuar"],
  film: ["Make a film", "Crear vídeo"],
  filming: ["The film is being made", "Se está creando el vídeo"],
  film_ready: ["Film", "Vídeo"],
  recording: ["Recording", "Grabación"],
  keys_hint: ["Arrow keys or W A S D drive, shift halves the speed, escape ends the drive; + and − zoom.",
    "Las flechas o W A S D conducen, mayúsculas reduce la velocidad a la mitad, escape termina; + y − cambian el aumento."],
  readings: ["Readings", "Lecturas"],
  r_time: ["Time", "Tiempo"], r_speed: ["Speed", "Velocidad"], r_clearance: ["Clearance", "Distancia libre"],
  r_least: ["Least clearance", "Distancia libre mínima"], r_to_go: ["To go", "Por recorrer"],
  r_energy: ["Energy", "Energía"], r_shield: ["Shield", "Escudo"], r_battery: ["Battery", "Batería"],
  shield_off: ["off", "apagado"], shield_free: ["nothing changed", "sin cambios"],
  obstacle: ["slows for an obstacle", "frena por un obstáculo"], moving: ["slows for somebody who moves", "frena por alguien que se mueve"],
  unseen: ["slows where it cannot see", "frena donde no puede ver"],
  stands: ["The chair stands: {text}", "La silla está parada: {text}"],
  map_label: ["The world from above, with the chair in it. The readings beside it say the same in words.",
    "El mundo desde arriba, con la silla. Las lecturas al lado dicen lo mismo con palabras."],
  zoom_in: ["Zoom in", "Acercar"], zoom_out: ["Zoom out", "Alejar"], fit: ["Show all", "Ver todo"],
  waiting: ["Ready. Time begins when you move the stick.", "Listo. El tiempo empieza cuando mueva la palanca."],
  driving: ["You drive to the green circle.", "Conduzca hasta el círculo verde."],
  paused: ["Paused", "En pausa"],
  success: ["You have arrived.", "Ha llegado."],
  collision: ["The chair has touched something. The drive has ended; start again.", "La silla ha tocado algo. El recorrido ha terminado; empiece de nuevo."],
  timeout: ["The time is over.", "Se acabó el tiempo."],
  missed: ["The chair believes to have arrived, and is not at the goal.", "La silla cree haber llegado, pero no está en la meta."],
  stopped: ["The drive has ended.", "El recorrido ha terminado."],
  figures: ["{time} s, {length} m (shortest {geodesic} m), least clearance {clearance} m, {energy} Wh; help changed {changed} % of the time",
    "{time} s, {length} m (mínimo {geodesic} m), distancia libre mínima {clearance} m, {energy} Wh; la ayuda intervino el {changed} % del tiempo"],
  not_recorded: ["Not recorded: {text}", "Sin grabación: {text}"],
  anew: ["The shield comes or goes with this assistant: the drive begins anew.", "El escudo cambia con este asistente: el recorrido empieza de nuevo."],
  k_goal: ["goal", "meta"], k_scan: ["laser", "láser"], k_cone: ["ultrasonics", "ultrasonidos"], k_person: ["people", "personas"],
  k_track: ["tracks, with their speed", "seguimientos, con su velocidad"], k_asked: ["stick", "palanca"], k_given: ["driven", "se conduce"],
  a_direct: ["No help, no shield: the chair does what the stick says.", "Sin ayuda ni escudo: la silla hace lo que dice la palanca."],
  a_shield: ["The stick, slowed by the shield before obstacles.", "La palanca, frenada por el escudo ante obstáculos."],
  a_teleop: ["Slows the chair in time before what it would hit.", "Frena la silla a tiempo antes de chocar."],
  a_vfh: ["Turns towards the free direction nearest to the stick's.", "Gira hacia la dirección libre más cercana a la de la palanca."],
  a_slide: ["Slides along obstacles in place of stopping.", "Se desliza a lo largo de los obstáculos en vez de parar."],
  a_shared_dwa: ["Chooses a safe motion near the stick's.", "Elige un movimiento seguro cercano al de la palanca."],
  a_hypotheses: ["Guesses where you are going, and helps when you would miss it.", "Adivina adónde va y ayuda cuando no acertaría."],
  a_blend: ["Mixes the stick with the way to the likeliest goal.", "Mezcla la palanca con el camino a la meta más probable."],
  a_hindsight: ["Helps towards all likely goals at once.", "Ayuda hacia todas las metas probables a la vez."],
  h_none: ["none", "ninguna"], h_essential_tremor: ["tremor", "temblor"], h_ataxia: ["ataxia", "ataxia"],
  h_spasticity: ["spasms", "espasmos"], h_weak_left: ["weak to the left", "débil a la izquierda"],
  h_biased: ["off centre", "descentrada"], h_isometric: ["isometric stick", "palanca isométrica"],
  h_chin: ["chin stick", "palanca de mentón"], h_head_array: ["head array", "control de cabeza"],
  h_sip_and_puff: ["sip and puff", "soplar y aspirar"], h_bci: ["brain-computer interface", "interfaz cerebro-ordenador"],
};

export const LANGUAGES = ["en", "es"];
let column = 0;

export function setLanguage(name) {
  column = Math.max(0, LANGUAGES.indexOf(name));
  document.documentElement.lang = LANGUAGES[column];
}

/** The text of a key, with values in place of {names}; the key itself where there is none. */
export function text(key, values = {}) {
  const row = ROWS[key];
  if (!row) return key;
  return row[column].replace(/\{(\w+)\}/g, (_, name) => values[name] ?? "");
}

/** Fill every element below a root that names its text (data-t) or its label (data-label). */
export function translate(root = document) {
  for (const one of root.querySelectorAll("[data-t]")) one.textContent = text(one.dataset.t);
  for (const one of root.querySelectorAll("[data-label]")) one.setAttribute("aria-label", text(one.dataset.label));
}
