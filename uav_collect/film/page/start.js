// Shows a mission that is over.

window.film = new Player(JSON.parse(byId('footage').textContent));
